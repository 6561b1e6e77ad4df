"""Robust fits of analytic primitives: many first guesses, few finalists, and no points that belong elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.refine import median_size, refine, tukey_weights, usual_size
from sed2cad.primitives.starts import starts, weighted_plane

_TRIAL_POINTS = 200  # to compare first guesses
_TRIALS = 6  # guesses that are worth a few steps
_TRIAL_STEPS = 6  # that tell which of them lead somewhere
START_POINTS = 1000  # to make them and to refine the best
_FINALISTS = 3  # that are refined until they rest
_STEPS = 40  # more than enough to rest; along the valley of a short arc a handful is not
_ROUNDS = 2  # of new guesses without the points that fit worst
_MAJORITY = 0.6  # of the points: those that belong
_OUTLIER = 12.0  # chi^2 of a point that belongs elsewhere
_MEDIAN_CHI2 = 1.386  # of two degrees of freedom: squared angles of normals with a deviation of 1
_FARTHEST = 3.5  # deviations of a normal that belongs
_DROPS = 3  # times that they are looked for, at most
_ENOUGH = 3  # points for each parameter, at least, when some are dropped
UNSEEN = 1e-4  # unit frame: deviations that nobody sees; the chords of a tessellation are as far off
FINEST = 3e-5  # unit frame: what a tessellation or rounding leaves; no evidence is sharper than this
_NORMAL_NOISE = 0.05  # radians; normals are not better than that


def robust_fit(kind: str, points: Array, normals: Array, noise: float) -> tuple[Primitive, Array] | None:
    """The primitive, and the points (m, 3) whose normals agree with it: only these have a say in the end."""
    primitive = _robust_plane(points, normals, noise) if kind == "plane" else _robust(kind, points, normals, noise)
    if primitive is None:
        return None
    kept = np.ones(len(points), bool)
    for _ in range(_DROPS):
        agreeing = _agreeing(primitive, points, normals)
        if (agreeing == kept).all() or agreeing.sum() < _ENOUGH * primitive.freedom:
            break
        kept = agreeing
        if kind == "plane":
            primitive = _robust_plane(points[kept], normals[kept], noise)
        else:
            primitive = refine(primitive, points[kept], noise, _STEPS)
    return primitive, points[kept]


def _robust(kind: str, points: Array, normals: Array, noise: float) -> Primitive | None:
    """The best of several starts, refined until it rests, on all points in the end.

    Least squares starts suffer from outliers, so there are new ones from the points that fit best so far (the
    concentration of Rousseeuw and Van Driessen 1999, Computing LTS Regression).
    """
    some, few = thinned(points, normals, START_POINTS), thinned(points, normals, _TRIAL_POINTS)
    trials = _tried(starts(kind, *some), *few, noise)
    for _ in range(_ROUNDS):
        if not trials:
            return None
        best = trials[0]
        if explains(best, few[0], max(noise, FINEST)):
            break
        trials = _ranked(trials + _tried(starts(kind, *_majority(best, *some)), *few, noise), *few, noise)
        if trials[0] is best:
            break
    finalists: list[Primitive] = []
    for trial in trials[:_FINALISTS]:
        finalists.append(refine(trial, few[0], noise, _STEPS))
        if explains(finalists[-1], few[0], max(noise, FINEST)):
            break
    best = refine(_ranked(finalists, *some, noise)[0], some[0], noise, _STEPS)
    return refine(best, points, noise, _STEPS) if len(points) > len(some[0]) else best


def _tried(guesses: Sequence[Primitive], points: Array, normals: Array, noise: float) -> list[Primitive]:
    """A few steps from each of the better guesses; the best first."""
    likely = _ranked(guesses, points, normals, noise)[:_TRIALS]
    return _ranked([refine(guess, points, noise, _TRIAL_STEPS) for guess in likely], points, normals, noise)


def _ranked(primitives: Sequence[Primitive], points: Array, normals: Array, noise: float) -> list[Primitive]:
    """The best first."""
    if not primitives:
        return []
    return [primitives[k] for k in np.argsort(misfits(primitives, points, normals, noise), kind="stable")]


def _majority(primitive: Primitive, points: Array, normals: Array) -> tuple[Array, Array]:
    """The points whose distances and normals fit best, and their normals."""
    square, angle = primitive.distance(points) ** 2, _angles(primitive, points, normals)
    misfit = square / max(median_size(square), 1e-18) + angle / max(median_size(angle), _NORMAL_NOISE**2)
    kept = np.sort(np.argsort(misfit, kind="stable")[: int(np.ceil(_MAJORITY * len(points)))])
    return points[kept], normals[kept]


def _angles(primitive: Primitive, points: Array, normals: Array) -> Array:
    """Squared angles (n,) between the primitive's normals and those of the points, whichever side they are on."""
    cosine = np.einsum("ij,ij->i", primitive.normal(points), normals)
    return np.asarray(2 - 2 * cosine * (-1.0 if cosine.sum() < 0 else 1.0))


def _agreeing(primitive: Primitive, points: Array, normals: Array) -> NDArray[np.bool_]:
    """The points (n,) whose normals agree with the primitive's, by the spread of those that do."""
    angle = _angles(primitive, points, normals)
    spread = max(median_size(angle) / _MEDIAN_CHI2, _NORMAL_NOISE**2)
    return np.asarray(angle <= _FARTHEST**2 * spread)


def _robust_plane(points: Array, normals: Array, noise: float) -> Plane:
    """Reweighted until the outliers are out; keeps the help of the normals in narrow strips."""
    plane = weighted_plane(points, normals, np.ones(len(points)))
    for _ in range(6):
        weights = tukey_weights(plane.distance(points), noise, plane.freedom)
        plane = weighted_plane(points, normals, weights)
    return plane


def explains(primitive: Primitive, points: Array, sigma: float) -> bool:
    """Whether the distances are about what the noise gives, some outliers aside."""
    return float(np.minimum((primitive.distance(points) / sigma) ** 2, _OUTLIER).mean()) < 2


def misfits(primitives: Sequence[Primitive], points: Array, normals: Array, noise: float) -> Array:
    """chi^2 (k,) of the distances and normals of each primitive, both capped.

    The unit is the noise, or what the best of them leaves if that is more; the normals err in groups, so they
    count less. Deviations of normals are measured as 2 (1 - cos), which is the angle squared.
    """
    distances = np.stack([primitive.distance(points) for primitive in primitives])
    angles = np.stack([_angles(primitive, points, normals) for primitive in primitives])
    sigma = max(noise, min(usual_size(row) for row in distances), 1e-9)
    spread = max(1.4826**2 * min(median_size(row) for row in angles), _NORMAL_NOISE**2)
    by_distance = np.minimum((distances / sigma) ** 2, _OUTLIER).sum(axis=1)
    return np.asarray(by_distance + 0.3 * np.minimum(angles / spread, 9).sum(axis=1))


def thinned(points: Array, normals: Array, most: int) -> tuple[Array, Array]:
    """At most so many of the points, spread over their order."""
    if len(points) <= most:
        return points, normals
    chosen = evenly(len(points), most)
    return points[chosen], normals[chosen]


def evenly(count: int, most: int) -> NDArray[np.int64]:
    """So many of the numbers (most,) below `count`, evenly spread."""
    return np.linspace(0, count - 1, most).astype(np.int64)
