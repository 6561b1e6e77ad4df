"""Small patches that are none: where normals are smoothed over an edge or a scanner rounds it, the segmentation finds
chips along it whose points lie on the faces beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.fitting import angle_noise
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.robust_fit import FINEST
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Array, Scan

_NEIGHBOURS = 12
_MOST = 400  # points of a chip: larger patches have a middle that tells them from their borders
_CAP = 6.0  # half chi^2 of a point that belongs elsewhere
_PRICE = 14.0  # half chi^2 that a patch has to save to be one


def absorbed(scan: Scan, fitted: Sequence[FittedPatch]) -> list[FittedPatch]:
    """The patches in order, without those whose points the patches around them explain nearly as well.

    These get the points, each the one that explains it best. The normals count where they tell something of a small
    patch: measured ones, not those that were estimated from the points.
    """
    angle = angle_noise(scan, fitted)
    owner = np.full(len(scan.points), -1)
    for k, patch in enumerate(fitted):
        owner[patch.patch.indices] = k
    tree = cKDTree(scan.points)
    sizes = [len(patch.patch.indices) for patch in fitted]
    for k in np.argsort(sizes, kind="stable"):
        if sizes[k] > _MOST:
            break
        own = np.flatnonzero(owner == k)
        around = np.unique(owner[tree.query(scan.points[own], _NEIGHBOURS)[1]])
        hosts = [n for n in around if n >= 0 and sizes[n] > sizes[k]]
        if not len(own) or not hosts:
            continue
        errors = _errors(scan, own, fitted[k], angle)
        costs = np.array([_cost(scan, own, fitted[n], *errors) for n in hosts])
        if (costs.min(axis=0) - _cost(scan, own, fitted[k], *errors)).sum() < _PRICE:
            owner[own] = np.array(hosts)[costs.argmin(axis=0)]
    return [_with_points(patch, own) for k, patch in enumerate(fitted) if len(own := np.flatnonzero(owner == k))]


def _errors(scan: Scan, own: NDArray[np.int64], patch: FittedPatch, angle: float) -> tuple[float, float]:
    """Deviation of the points and of their normals: of the scan, or of the chip from its own surface where larger."""
    points, normals = scan.points[own], scan.normals[own]
    return (
        max(scan.noise, FINEST, root_mean_square(patch.primitive.distance(points))),
        max(angle, root_mean_square(patch.primitive.angles(points, normals))),
    )


def _cost(scan: Scan, own: NDArray[np.int64], patch: FittedPatch, sigma: float, angle: float) -> Array:
    """Half chi^2 (n,) of points under a patch, capped; their deviation is sigma, that of their normals angle."""
    points, normals = scan.points[own], scan.normals[own]
    distance, out = patch.primitive.distance_and_normal(points)
    squares = (distance / sigma) ** 2
    if math.isfinite(angle):
        squares += 2 * (1 - patch.sign * np.einsum("ij,ij->i", out, normals)) / angle**2
    return np.asarray(np.minimum(0.5 * squares, _CAP))


def _with_points(patch: FittedPatch, own: NDArray[np.int64]) -> FittedPatch:
    """The patch with its points and some from chips, which are no inner ones."""
    old = patch.patch
    if len(own) == len(old.indices):
        return patch
    inner = np.isin(own, old.indices[old.interior])
    return replace(patch, patch=Patch(own, old.kind, inner))
