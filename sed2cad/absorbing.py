"""Small patches that are none: where normals are smoothed over an edge or a scanner rounds it, the segmentation finds
chips along it whose points lie on the faces beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.fitting import angle_noise
from sed2cad.primitives.base import UNLABELLED, FittedPatch, Patch, point_labels
from sed2cad.primitives.refine import usual_size
from sed2cad.primitives.robust_fit import FINEST
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.energy import Tolerances, data_cost

_NEIGHBOURS = 12
_WITHIN = 1.0  # mean cost of points that lie within the noise: that of squares twice as large as expected
_MOST = 400  # points of a chip: larger patches have a middle that tells them from their borders


def absorbed(scan: Scan, fitted: Sequence[FittedPatch]) -> list[FittedPatch]:
    """The patches in order, without those whose points the patches around them explain nearly as well, or within the
    noise: among points that were chosen for lying off, some always fit another surface better.

    These get the points, each the one that explains it best, in the terms of the segmentation's energy. The normals
    count where they tell something of a small patch: measured ones, not those that were estimated from the points.
    """
    angle = angle_noise(scan, fitted)
    owner = point_labels(len(scan.points), fitted)
    tree = cKDTree(scan.points)
    sizes = [len(patch.patch.indices) for patch in fitted]
    for k in np.argsort(sizes, kind="stable"):
        if sizes[k] > _MOST:
            break
        own = np.flatnonzero(owner == k)
        around = np.unique(owner[tree.query(scan.points[own], _NEIGHBOURS)[1]])
        hosts = [n for n in around if n != UNLABELLED and sizes[n] > sizes[k]]
        if not len(own) or not hosts or fitted[k].tied:
            continue
        tolerances = _tolerances(scan, own, fitted[k], angle)
        points, normals = scan.points[own], scan.normals[own]
        ways = [(fitted[n].primitive, fitted[n].sign) for n in (k, *hosts)]
        now, *others = (data_cost(surface, sign, points, normals, tolerances) for surface, sign in ways)
        costs = np.array(others)
        least = costs.min(axis=0)
        if (least - now).sum() < tolerances.primitive or least.mean() < _WITHIN:
            owner[own] = np.array(hosts)[costs.argmin(axis=0)]
    return [_with_points(patch, own) for k, patch in enumerate(fitted) if len(own := np.flatnonzero(owner == k))]


def _tolerances(scan: Scan, own: NDArray[np.int64], patch: FittedPatch, angle: float) -> Tolerances:
    """Deviations of the points and of their normals: of the scan, or of most of the chip from its own surface where
    larger."""
    points, normals = scan.points[own], scan.normals[own]
    return Tolerances(
        distance=max(scan.noise, FINEST, usual_size(patch.primitive.distance(points))),
        angle=max(angle, usual_size(patch.primitive.angles(points, normals))),
    )


def _with_points(patch: FittedPatch, own: NDArray[np.int64]) -> FittedPatch:
    """The patch with its points and some from chips, which are no inner ones."""
    old = patch.patch
    if len(own) == len(old.indices):
        return patch
    inner = np.isin(own, old.indices[old.interior])
    return replace(patch, patch=Patch(own, old.kind, inner))
