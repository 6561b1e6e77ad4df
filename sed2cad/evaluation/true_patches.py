"""Patches whose surface is known: points off along the normal, outliers, part of a shape of size 1, in any pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import unit

NORMAL_NOISE = 5.0  # degrees, of normals estimated from a scan
_MARGIN = 0.1  # of the size: outliers lie in the box of the patch, this much larger on all sides
_Z = np.array([0.0, 0.0, 1.0])
_ORIGIN = np.zeros(3)
FREEFORM = ("wave", "lobes")


@dataclass(frozen=True)
class TruePatch:
    """What a fit sees, and the truth."""

    primitive: Primitive | None  # None for a freeform surface
    points: Array  # (n, 3)
    normals: Array  # (n, 3)
    feet: Array  # (n, 3), on the true surface; where there would be no outliers
    inlier: NDArray[np.bool_]  # (n,)


def true_patch(
    shape: str, count: int, coverage: float, noise: float, outliers: float, rng: np.random.Generator
) -> TruePatch:
    """A sample of `coverage` degrees (360: all of it) of a shape of size 1: an analytic kind, wave or lobes.

    The noise is Gaussian along the true normal, in units of the size; a share of `outliers` is anywhere near, with
    any normal.
    """
    return placed(*_SHAPES[shape](rng, count, coverage), noise, outliers, rng)


def placed(
    primitive: Primitive | None,
    feet: Array,
    normals: Array,
    noise: float,
    outliers: float,
    rng: np.random.Generator,
) -> TruePatch:
    """Noise, outliers and a random pose for feet and normals (n, 3) of a surface."""
    count = len(feet)
    points = feet + noise * rng.normal(size=(count, 1)) * normals
    tilted = unit(normals + np.radians(NORMAL_NOISE) * rng.normal(size=(count, 3)))
    inlier = np.arange(count) >= round(outliers * count)
    inlier = rng.permutation(inlier)
    strays = int((~inlier).sum())
    points[~inlier] = rng.uniform(feet.min(axis=0) - _MARGIN, feet.max(axis=0) + _MARGIN, (strays, 3))
    tilted[~inlier] = unit(rng.normal(size=(strays, 3)))
    turn, shift = _rotation(rng), rng.uniform(-0.3, 0.3, 3)
    truth = None if primitive is None else posed(primitive, turn, shift)
    return TruePatch(truth, points @ turn.T + shift, tilted @ turn.T, feet @ turn.T + shift, inlier)


def posed(primitive: Primitive, turn: Array, shift: Array) -> Primitive:
    """An analytic primitive under p -> turn p + shift. TypeError for another one."""
    match primitive:
        case Plane(normal_vector=normal, offset=offset):
            return Plane(turn @ normal, offset + float(turn @ normal @ shift))
        case Cylinder(axis=axis, point=point, radius=radius):
            return Cylinder(turn @ axis, turn @ point + shift, radius)
        case Cone(axis=axis, apex=apex, half_angle=half_angle, reach=reach):
            return Cone(turn @ axis, turn @ apex + shift, half_angle, reach)
        case Sphere(centre=centre, radius=radius):
            return Sphere(turn @ centre + shift, radius)
        case Torus(axis=axis, centre=centre, major_radius=major, minor_radius=minor):
            return Torus(turn @ axis, turn @ centre + shift, major, minor)
    raise TypeError(f"a {primitive.kind} cannot be posed")


def cone_points(
    rng: np.random.Generator, count: int, coverage: float, half_angle: float, apex: float, low: float, high: float
) -> tuple[Primitive, Array, Array]:
    """A cone about z with its apex at height `apex`, between two heights above it."""
    angle, height = _angles(rng, count, coverage), np.sqrt(rng.uniform(low**2, high**2, count))
    sin, cos, radial = np.sin(half_angle), np.cos(half_angle), _radial(angle)
    feet = np.tan(half_angle) * height[:, None] * radial + (apex + height)[:, None] * _Z
    return Cone(_Z, apex * _Z, half_angle), feet, cos * radial - sin * _Z


def cylinder_points(
    rng: np.random.Generator, count: int, coverage: float, radius: float, height: float
) -> tuple[Primitive, Array, Array]:
    """About z, its middle at the origin."""
    radial = _radial(_angles(rng, count, coverage))
    feet = radius * radial + height * rng.uniform(-0.5, 0.5, (count, 1)) * _Z
    return Cylinder(_Z, _ORIGIN, radius), feet, radial


def torus_points(
    rng: np.random.Generator, count: int, coverage: float, tube: float, major: float, minor: float
) -> tuple[Primitive, Array, Array]:
    """About z; `tube` degrees of the tube, amid 45 degrees up from its outermost circle; uniform in its angles."""
    around = _angles(rng, count, tube) + np.pi / 4
    radial = _radial(_angles(rng, count, coverage))
    normals = np.cos(around)[:, None] * radial + np.sin(around)[:, None] * _Z
    return Torus(_Z, _ORIGIN, major, minor), major * radial + minor * normals, normals


def _plane(rng: np.random.Generator, count: int, coverage: float) -> tuple[Primitive, Array, Array]:
    """A strip; its width is the coverage."""
    flat = rng.uniform(-0.5, 0.5, (count, 2)) * [0.8, 0.6 * coverage / 360]
    return Plane(_Z, 0.0), np.column_stack([flat, np.zeros(count)]), np.tile(_Z, (count, 1))


def _cylinder(rng: np.random.Generator, count: int, coverage: float) -> tuple[Primitive, Array, Array]:
    return cylinder_points(rng, count, coverage, radius=0.3, height=0.8)


def _cone(rng: np.random.Generator, count: int, coverage: float) -> tuple[Primitive, Array, Array]:
    return cone_points(rng, count, coverage, half_angle=np.pi / 6, apex=-0.5, low=0.25, high=0.7)


def _sphere(rng: np.random.Generator, count: int, coverage: float) -> tuple[Primitive, Array, Array]:
    return sphere_points(rng, count, coverage, radius=0.5)


def sphere_points(
    rng: np.random.Generator, count: int, coverage: float, radius: float
) -> tuple[Primitive, Array, Array]:
    """A cap about z that opens by the coverage."""
    cosine = rng.uniform(np.cos(np.radians(coverage / 2)), 1, count)
    normals = np.sqrt(1 - cosine**2)[:, None] * _radial(_angles(rng, count, 360)) + cosine[:, None] * _Z
    return Sphere(_ORIGIN, radius), radius * normals, normals


def _torus(rng: np.random.Generator, count: int, coverage: float) -> tuple[Primitive, Array, Array]:
    """As much of the tube as of the turn, but a quarter at least: a fillet."""
    return torus_points(rng, count, coverage, tube=max(coverage, 90.0), major=0.35, minor=0.15)


def _wave(rng: np.random.Generator, count: int, coverage: float) -> tuple[None, Array, Array]:
    x, y = rng.uniform(-0.35, 0.35, (2, count))
    slope_x, slope_y = 0.5 * np.cos(5 * x) * np.cos(4 * y), -0.4 * np.sin(5 * x) * np.sin(4 * y)
    feet = np.column_stack([x, y, 0.1 * np.sin(5 * x) * np.cos(4 * y)])
    return None, feet, unit(np.column_stack([-slope_x, -slope_y, np.ones(count)]))


def _lobes(rng: np.random.Generator, count: int, coverage: float) -> tuple[None, Array, Array]:
    """A tube of three lobes."""
    angle, height = _angles(rng, count, 360), rng.uniform(-0.4, 0.4, count)
    radius, slope = 0.25 + 0.03 * np.cos(3 * angle), -0.09 * np.sin(3 * angle)
    radial, around = _radial(angle), _radial(angle + np.pi / 2)
    feet = radius[:, None] * radial + height[:, None] * _Z
    return None, feet, unit(radial - (slope / radius)[:, None] * around)


def _angles(rng: np.random.Generator, count: int, arc: float) -> Array:
    return np.asarray(np.radians(rng.uniform(-arc / 2, arc / 2, count)))


def _radial(angle: Array) -> Array:
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])


def _rotation(rng: np.random.Generator) -> Array:
    """Uniform (Haar) rotation (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


_SHAPES: dict[str, Callable[[np.random.Generator, int, float], tuple[Primitive | None, Array, Array]]] = {
    "plane": _plane,
    "cylinder": _cylinder,
    "cone": _cone,
    "sphere": _sphere,
    "torus": _torus,
    "wave": _wave,
    "lobes": _lobes,
}
