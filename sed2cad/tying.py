"""Patches of a few points that tell no surface alone: about the axis of a patch beside them they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.primitives.base import UNLABELLED, Array, FittedPatch, Primitive, point_labels
from sed2cad.primitives.coaxial import NUMBERS, axis_of, coaxial
from sed2cad.primitives.oriented_fit import directions, facing
from sed2cad.primitives.refine import uncertainty
from sed2cad.primitives.registry import primitive_class
from sed2cad.primitives.robust_fit import FINEST, UNSEEN
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.energy import COARSE

_TOLD = 3  # numbers that a point tells with its normal
_ENOUGH = 2.0  # numbers told for each one asked, from which on a fit is left alone
_BESIDE = 12  # nearest points that tell the patches beside
_ALLOWED = 9.0  # chi^2 of each point and its normal, at most on average


def tied(scan: Scan, fitted: Sequence[FittedPatch], angle: float) -> list[FittedPatch]:
    """The patches in order, those with too few points on the best surface of their kind about an axis beside them.

    angle: deviation of the scan's normals, radians; infinite where it is not known: then nothing is tied in a noisy
    scan, where they may bend towards the borders of a patch.
    """
    few = [k for k, patch in enumerate(fitted) if _is_open(patch)]
    if not few or (np.isinf(angle) and scan.noise > FINEST):
        return list(fitted)
    owner = point_labels(len(scan.points), fitted)
    angle, noise, tree = min(angle, COARSE), max(scan.noise, UNSEEN), cKDTree(scan.points)
    out = list(fitted)
    for k in few:
        points, normals = scan.points[fitted[k].patch.indices], scan.normals[fitted[k].patch.indices]
        beside = np.setdiff1d(owner[tree.query(points, min(_BESIDE, len(owner)))[1]], [UNLABELLED, *few])
        axes = [axis for n in beside if (axis := axis_of(fitted[n].primitive)) is not None]
        about = [coaxial(fitted[k].patch.kind, *axis, points, normals) for axis in axes]
        rated = [(_misfit(surface, points, normals, noise, angle), surface) for surface in about if surface is not None]
        misfit, surface = min(rated, key=lambda pair: pair[0], default=(np.inf, None))
        if surface is not None and misfit < _ALLOWED * len(points):
            out[k] = _on(surface, fitted[k], points, normals, noise, angle)
    return out


def _is_open(patch: FittedPatch) -> bool:
    """Whether its points tell too few numbers for its kind."""
    kind = patch.patch.kind
    return kind in NUMBERS and _TOLD * len(patch.patch.indices) < _ENOUGH * primitive_class(kind).freedom


def _misfit(primitive: Primitive, points: Array, normals: Array, noise: float, angle: float) -> float:
    """chi^2 of points (n, 3) and their normals."""
    turned = facing(primitive, points, normals) - primitive.normal(points)
    return float(((primitive.distance(points) / noise) ** 2).sum() + (turned**2).sum() / angle**2)


def _on(
    surface: Primitive, patch: FittedPatch, points: Array, normals: Array, noise: float, angle: float
) -> FittedPatch:
    """The patch on a surface about an axis, and what its points say of all numbers of that."""
    told = uncertainty(surface, points, noise, directions(surface, points, normals, noise, angle))
    rms = root_mean_square(surface.distance(points))
    sign = surface.side(points, normals)
    return replace(patch, primitive=surface, sign=sign, rms=rms, covariance=told.covariance, tied=True)
