"""Algebraic first guesses: one small linear problem each, from points (n, 3) and unit normals (n, 3).

The normals may point to either side, but all of a patch to the same one. Sources: the Gauss map and the line
complex of a surface of revolution are in Pottmann and Wallner, Computational Line Geometry, chapter 7.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import about_axis, tangent_frame, unit

_NORMAL_SPREAD = 0.03  # radians: how well the mean of a patch's normals is known
_FAN = (-60.0, -40.0, -20.0, 20.0, 40.0, 60.0)  # degrees: half angles to try


def starts(kind: str, points: Array, normals: Array) -> list[Primitive]:
    """First guesses for one kind of analytic primitive, in no order; perhaps none."""
    try:
        with np.errstate(all="ignore"):
            found = _STARTS[kind](points, normals)
    except np.linalg.LinAlgError:  # coinciding points
        return []
    return [primitive for primitive in found if is_proper(primitive)]


def is_proper(primitive: Primitive) -> bool:
    """Finite numbers, positive radii, an angle that makes a cone."""
    if isinstance(primitive, Plane):
        return bool(np.isfinite(primitive.normal_vector.sum() + primitive.offset))
    if isinstance(primitive, Cylinder):
        return bool(np.isfinite(primitive.axis.sum() + primitive.point.sum()) and 0 < primitive.radius < 1e9)
    if isinstance(primitive, Cone):
        finite = np.isfinite(primitive.axis.sum() + primitive.apex.sum())
        return bool(finite and 1e-6 < primitive.half_angle < np.pi / 2 - 1e-6)
    if isinstance(primitive, Sphere):
        return bool(np.isfinite(primitive.centre.sum()) and 0 < primitive.radius < 1e9)
    if isinstance(primitive, Torus):
        finite = np.isfinite(primitive.axis.sum() + primitive.centre.sum())
        return bool(finite and 0 < primitive.major_radius < 1e9 and 0 < primitive.minor_radius < 1e9)
    return True


def _planes(points: Array, normals: Array) -> list[Primitive]:
    return [weighted_plane(points, normals, np.ones(len(points)))]


def weighted_plane(points: Array, normals: Array, weights: Array) -> Plane:
    """Least spread of the points; in a strip, where that leaves the tilt open, the normals decide.

    The most likely normal when the thickness of the patch is its noise and the mean of its normals is right
    to within `_NORMAL_SPREAD`.
    """
    share = weights / weights.sum()
    centre, mean = share @ points, share @ normals
    offset = points - centre
    spread = (offset * share[:, None]).T @ offset
    thickness = max(np.linalg.eigvalsh(spread)[0], 1e-9 * np.trace(spread), 1e-30)
    trust = thickness / (len(points) * _NORMAL_SPREAD**2)
    normal = np.linalg.eigh(spread - trust * (normals * share[:, None]).T @ normals)[1][:, 0]
    normal = normal if normal @ mean >= 0 else -normal
    return Plane(normal, float(normal @ centre))


def _spheres(points: Array, normals: Array) -> list[Primitive]:
    centre, mean = points.mean(axis=0), normals.mean(axis=0)
    radius = _signed_radius(points - centre, normals - mean)
    return [Sphere(centre - radius * mean, abs(radius)), _sphere_by_points(points, centre)]


def _sphere_by_points(points: Array, near: Array) -> Sphere:
    """|p - near|^2 = 2 p . c + const, linear in the centre (Kasa)."""
    offset = points - near
    system = np.column_stack([2 * offset, np.ones(len(points))])
    solution = np.linalg.lstsq(system, np.einsum("ij,ij->i", offset, offset), rcond=1e-12)[0]
    return Sphere(near + solution[:3], float(np.sqrt(solution[3] + solution[:3] @ solution[:3])))


def _cylinders(points: Array, normals: Array) -> list[Primitive]:
    offset = points - points.mean(axis=0)
    axes = [_flattest(normals), _longest(offset)]
    return [cylinder for axis in axes for cylinder in _cylinders_about(axis, points, normals)]


def _cylinders_about(axis: Array, points: Array, normals: Array) -> list[Primitive]:
    """Circle of the points seen along the axis: once by the normals, once by the points alone."""
    across = np.column_stack(tangent_frame(axis))
    centre = points.mean(axis=0)
    flat, arrows = (points - centre) @ across, unit(normals @ across)
    radius = _signed_radius(flat, arrows - arrows.mean(axis=0))
    by_normals = Cylinder(axis, centre - across @ (radius * arrows.mean(axis=0)), abs(radius))
    middle, size = _circle(flat)
    return [by_normals, Cylinder(axis, centre + across @ middle, size)]


def _cones(points: Array, normals: Array) -> list[Primitive]:
    """About the axis of the normals' circle; in a narrow sector, where that is vague, about a fan of axes."""
    mean = unit(normals.mean(axis=0))
    spread = normals - normals.mean(axis=0)
    axes = [_flattest(spread), _flattest(normals)]
    sideways = _longest(spread)
    along = unit(np.cross(mean, sideways))  # a generatrix in the middle of the sector
    axes += [np.cos(angle) * along - np.sin(angle) * mean for angle in np.radians(_FAN)]
    return [*(_cone_about(axis, points, normals) for axis in axes), _cone_by_apex(points, normals)]


def _cone_by_apex(points: Array, normals: Array) -> Cone:
    """All tangent planes hold the apex, so n x (p - apex) is across the axis; good for blunt cones."""
    apex = np.linalg.lstsq(normals, np.einsum("ij,ij->i", normals, points), rcond=1e-9)[0]
    axis = _flattest(unit(np.cross(normals, points - apex)))
    axis = axis if (points.mean(axis=0) - apex) @ axis > 0 else -axis
    height, radius, _ = about_axis(points, apex, axis)
    return Cone(axis, apex, float(np.median(np.arctan2(radius, height))))


def _cone_about(axis: Array, points: Array, normals: Array) -> Cone:
    """p = centre + (r + k height) radial, across the axis: linear in centre, r and k."""
    across = np.column_stack(tangent_frame(axis))
    middle = points.mean(axis=0)
    flat, arrows, height = (points - middle) @ across, unit(normals @ across), (points - middle) @ axis
    ones, zeros = np.ones(len(points)), np.zeros(len(points))
    rows_x = np.column_stack([ones, zeros, arrows[:, 0], height * arrows[:, 0]])
    rows_y = np.column_stack([zeros, ones, arrows[:, 1], height * arrows[:, 1]])
    system, right = np.vstack([rows_x, rows_y]), flat.T.ravel()
    x, y, radius, slope = np.linalg.lstsq(system, right, rcond=1e-12)[0]
    radius, slope = abs(radius), slope * (1 if radius >= 0 else -1)
    slope = slope if abs(slope) > 1e-4 else 1e-4
    apex = middle + across @ np.array([x, y]) - axis * (radius / slope)
    return Cone(axis if slope > 0 else -axis, apex, float(np.arctan(abs(slope))))


def _tori(points: Array, normals: Array) -> list[Primitive]:
    found = [torus_about(axis, origin, points, normals) for axis, origin in revolution_axes(points, normals)]
    return [*found, _torus_by_tube(points, normals)]


def revolution_axes(points: Array, normals: Array) -> list[tuple[Array, Array]]:
    """Axes (direction, point) that all normal lines nearly meet, the best first.

    A normal line with Pluecker coordinates (n, p x n) meets the axis (a, b) where a . (p x n) + b . n = 0.
    """
    middle = points.mean(axis=0)
    size = np.sqrt(((points - middle) ** 2).sum(axis=1).mean())
    moments = np.cross((points - middle) / size, normals)
    coupling, lines = moments.T @ normals, normals.T @ normals
    back = -np.linalg.pinv(lines, rcond=1e-6) @ coupling.T  # best b for a given a
    directions = np.linalg.eigh(moments.T @ moments + coupling @ back)[1].T
    return [(axis, middle + size * np.cross(axis, back @ axis)) for axis in directions]


def torus_about(axis: Array, origin: Array, points: Array, normals: Array) -> Torus:
    """The meridian circle in the half plane (radius, height), by the normals."""
    height, radius, radial = about_axis(points, origin, axis)
    meridian = np.column_stack([radius, height])
    arrows = unit(np.column_stack([np.einsum("ij,ij->i", normals, radial), normals @ axis]))
    minor = _signed_radius(meridian - meridian.mean(axis=0), arrows - arrows.mean(axis=0))
    major, rise = meridian.mean(axis=0) - minor * arrows.mean(axis=0)
    return Torus(axis, origin + rise * axis, float(major), abs(minor))


def _torus_by_tube(points: Array, normals: Array) -> Torus:
    """p - r n lies on the centre circle: (p - mean) . a = (n - mean) . b, with b = r a."""
    middle = points.mean(axis=0)
    offset, spread = points - middle, normals - normals.mean(axis=0)
    size = np.sqrt((offset**2).sum() / max((spread**2).sum(), 1e-12))
    system = np.hstack([offset, -size * spread])
    a, b = np.linalg.eigh(system.T @ system)[1][:, 0].reshape(2, 3)
    axis, minor = unit(a), size * float(a @ b) / max(float(a @ a), 1e-12)
    tube = offset - minor * normals
    across = np.column_stack(tangent_frame(axis))
    centre, major = _circle(tube @ across)
    return Torus(axis, middle + across @ centre + axis * float((tube @ axis).mean()), major, abs(minor))


def _signed_radius(offset: Array, spread: Array) -> float:
    """r of p = c + r n from centred points and normals (n, d); negative where the normals point inwards."""
    return float(np.sum(offset * spread) / max(float(np.sum(spread * spread)), 1e-12))


def _circle(flat: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle through points (n, 2) (Kasa, centred)."""
    middle = flat.mean(axis=0)
    offset = flat - middle
    square = np.einsum("ij,ij->i", offset, offset)
    centre = np.linalg.lstsq(2 * offset, square - square.mean(), rcond=1e-12)[0]
    return middle + centre, float(np.sqrt(square.mean() + centre @ centre))


def _flattest(vectors: Array) -> Array:
    """The direction (3,) that vectors (n, 3) have least of."""
    return np.asarray(np.linalg.eigh(vectors.T @ vectors)[1][:, 0])


def _longest(vectors: Array) -> Array:
    """The direction (3,) that vectors (n, 3) have most of."""
    return np.asarray(np.linalg.eigh(vectors.T @ vectors)[1][:, 2])


_STARTS: dict[str, Callable[[Array, Array], list[Primitive]]] = {
    "plane": _planes,
    "cylinder": _cylinders,
    "cone": _cones,
    "sphere": _spheres,
    "torus": _tori,
}
