"""Fits that listen to the measured normals: where a patch is hardly larger than the noise, these know more than the
points do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.refine import Directions, median_size, refine
from sed2cad.primitives.registry import primitive_class
from sed2cad.primitives.robust_fit import FINEST, thinned
from sed2cad.primitives.starts import starts

_POINTS = 300  # of a patch, to compare guesses by
_STEPS = 30
_GUESSES = 3  # that are refined
_OUTLIER = 12.0  # chi^2 of a point that belongs elsewhere
_REACH = 10.0  # times the noise over the angle: patches wider than this know their directions by the points
_MEDIAN_CHI2 = 1.386  # of two degrees of freedom
_LEAST_ANGLE = 0.02  # radians: no scanner's normals are better, nor is a mesh's
_FARTHEST = 3.5  # deviations of a normal that belongs
_TOGETHER = 0.5  # correlation of neighbours from which on they do not err independently
_ENOUGH = 30  # points of a patch that tell how good the normals are


def normal_noise(primitives: Sequence[Primitive], points: Sequence[Array], normals: Sequence[Array]) -> float:
    """Deviation of a component of the normals across the true ones, radians, by the patches that tell it.

    The median over all of their points of the squared angle to the primitive, over that of chi^2. Infinite where there
    are none, or where neighbours err together: such normals were estimated from the points, or are those of a mesh, and
    say nothing of a small patch but what its borders have made of them.
    """
    found = [
        (at, facing(primitive, at, out) - primitive.normal(at))
        for primitive, at, out in zip(primitives, points, normals)
        if len(at) >= _ENOUGH
    ]
    if not found:
        return float("inf")
    squares = np.concatenate([np.square(gaps).sum(axis=1) for _, gaps in found])
    angle = max(float(np.sqrt(median_size(squares) / _MEDIAN_CHI2)), _LEAST_ANGLE)
    return angle if _likeness(found, _FARTHEST * angle) < _TOGETHER else float("inf")


def _likeness(found: Sequence[tuple[Array, Array]], most: float) -> float:
    """Correlation of the gaps (n, 3) at points (n, 3) with those at the nearest ones, without gaps above `most`."""
    products, squares = 0.0, 0.0
    for points, gaps in found:
        some = np.linspace(0, len(points) - 1, min(len(points), _POINTS)).astype(np.int64)
        other = gaps[cKDTree(points).query(points[some], 2)[1][:, 1]]
        gaps = gaps[some]
        fair = (np.square(gaps).sum(axis=1) < most**2) & (np.square(other).sum(axis=1) < most**2)
        products += float((gaps[fair] * other[fair]).sum())
        squares += float((gaps[fair] ** 2).sum() + (other[fair] ** 2).sum()) / 2
    return products / max(squares, 1e-30)


def facing(primitive: Primitive, points: Array, normals: Array) -> Array:
    """The normals (n, 3), turned to the side that the primitive's point to."""
    return normals * primitive.side(points, normals)


def directions(
    primitive: Primitive, points: Array, normals: Array, noise: float, angle: float
) -> Directions | None:
    """What the normals (n, 3) have to say; None where the points know much better."""
    if points_know_better(points, noise, angle):
        return None
    return Directions(facing(primitive, points, normals), angle, max(noise, FINEST))


def points_know_better(points: Array, noise: float, angle: float) -> bool:
    """Whether the points (n, 3) spread so wide that they tell directions better than their normals do."""
    return not np.isfinite(angle) or _width(points) > _REACH * max(noise, FINEST) / angle


def oriented_fit(
    kind: str, found: Primitive | None, points: Array, normals: Array, noise: float, angle: float
) -> Primitive | None:
    """The best on points (n, 3) and normals (n, 3) together, from what the points alone have found and from guesses.

    `found` where the points know better, or nothing fits.
    """
    if points_know_better(points, noise, angle) or 3 * len(points) < primitive_class(kind).freedom:
        return found
    noise, few = max(noise, FINEST), thinned(points, normals, _POINTS)
    guesses = sorted(starts(kind, *few), key=lambda guess: _misfit(guess, *few, noise, angle))
    guesses = [*([] if found is None else [found]), *guesses[:_GUESSES]]
    trials = [_refined(guess, *few, noise, angle) for guess in guesses]
    best = min(trials, key=lambda trial: _misfit(trial, *few, noise, angle), default=None)
    return best if best is None or len(points) == len(few[0]) else _refined(best, points, normals, noise, angle)


def _refined(guess: Primitive, points: Array, normals: Array, noise: float, angle: float) -> Primitive:
    """The guess moved downhill on the distances of points (n, 3) and the angles of their normals."""
    return refine(guess, points, noise, _STEPS, directions=directions(guess, points, normals, noise, angle))


def _misfit(primitive: Primitive, points: Array, normals: Array, noise: float, angle: float) -> float:
    """-2 log likelihood of distances and angles up to a constant, with what a point can cost capped."""
    said = Directions(facing(primitive, points, normals), angle, noise)
    whitening = said.whitening(primitive, points)
    turned = (said.gaps(primitive, points, whitening) / noise) ** 2
    off = (primitive.distance(points) / noise) ** 2
    blur = -2 * np.log(np.abs(np.linalg.det(whitening * (angle / noise)))).sum()
    return float(np.minimum(off, _OUTLIER).sum() + np.minimum(turned.sum(axis=1), _OUTLIER).sum() + blur)


def _width(points: Array) -> float:
    """Extent across the longest direction of the points (n, 3): the second of their principal ones."""
    offset = points - points.mean(axis=0)
    values = np.linalg.eigvalsh(offset.T @ offset / len(points))
    return float(np.sqrt(12 * max(values[1], 0.0)))
