"""One freeform surface for pieces of a face that the segmentation cut up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sed2cad.fitting import fit, parameter_count, swept_instead_of
from sed2cad.primitives.base import Array, FittedPatch, Patch, Primitive
from sed2cad.primitives.robust_fit import FINEST, thinned
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Scan

_MOST_POINTS = 3000  # to judge by
_TRIAL_POINTS = 1000  # to see whether a skin is worth fitting to all
_OUTLIER = 12.0  # chi^2 of a point that belongs elsewhere
_PRICE = 3.0  # of a number that shapes a surface, in chi^2
_FACE = 28.0  # of a face with its border: that of a patch in the segmentation


def skin(scan: Scan, pieces: Sequence[FittedPatch]) -> FittedPatch | None:
    """One freeform or swept surface over all pieces; None where that costs more than theirs do.

    The cost is chi^2 + a price for each number that shapes a surface and for each face (Schwarz 1978).
    """
    indices = np.concatenate([piece.patch.indices for piece in pieces])
    points, normals = scan.points[indices], scan.normals[indices]
    sigma, share = max(scan.noise, FINEST), min(1.0, _MOST_POINTS / len(points))
    least = sum(_cost(piece.primitive, scan.points[piece.patch.indices], sigma, share) for piece in pieces)
    primitive: Primitive | None = None
    for seen in sorted({min(count, len(points)) for count in (_TRIAL_POINTS, len(points))}):
        found = fit("bspline", *thinned(points, normals, seen), scan.noise)
        if found is None or _cost(found[0], points, sigma, share) > least:
            return None
        primitive, _, covariance = found
    assert primitive is not None
    swept = swept_instead_of(primitive, points, normals, scan.noise)
    return whole(scan, pieces, *(swept or (primitive, covariance)))


def whole(scan: Scan, pieces: Sequence[FittedPatch], primitive: Primitive, covariance: Array) -> FittedPatch:
    """The points of all pieces on one surface."""
    indices = np.concatenate([piece.patch.indices for piece in pieces])
    interior = np.concatenate([piece.patch.interior for piece in pieces])
    points, normals = scan.points[indices], scan.normals[indices]
    rms = root_mean_square(primitive.distance(points))
    patch = Patch(indices, "bspline", interior)
    return FittedPatch(patch, primitive, primitive.side(points, normals), rms, covariance)


def _cost(surface: Primitive, points: Array, sigma: float, share: float) -> float:
    """Of a surface and a share of its points (n, 3)."""
    square = np.minimum((surface.distance(points) / sigma) ** 2, _OUTLIER)
    return float(share * square.sum() + _PRICE * parameter_count(surface) + _FACE)
