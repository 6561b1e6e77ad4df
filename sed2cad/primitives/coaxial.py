"""Surfaces about a given axis: so much is known of them that a point or two with normals tell the rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.starts import is_proper, torus_about
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import about_axis, unit

NUMBERS = {"plane": 1, "cylinder": 1, "cone": 2}
"""Numbers that are left to be told once the axis is known."""


def coaxial(kind: str, axis: Array, origin: Array, points: Array, normals: Array) -> Primitive | None:
    """The plane across, or the cylinder, cone or torus about an axis (direction and origin, (3,)) that is nearest to
    points (n, 3) and unit normals (n, 3); None where there is none."""
    found = _ABOUT[kind](axis, origin, points, normals)
    return found if found is not None and is_proper(found) else None


def axis_of(primitive: Primitive) -> tuple[Array, Array] | None:
    """Direction and origin (3,) of the axis, if there is just one."""
    if isinstance(primitive, Cylinder):
        return primitive.axis, primitive.point
    if isinstance(primitive, Cone):
        return primitive.axis, primitive.apex
    return (primitive.axis, primitive.centre) if isinstance(primitive, Torus) else None


def _plane(axis: Array, origin: Array, points: Array, normals: Array) -> Primitive:
    side = 1.0 if (normals @ axis).sum() >= 0 else -1.0
    return Plane(side * axis, side * float((points @ axis).mean()))


def _cylinder(axis: Array, origin: Array, points: Array, normals: Array) -> Primitive:
    height, radius, _ = about_axis(points, origin, axis)
    return Cylinder(axis, origin + height.mean() * axis, float(radius.mean()))


def _cone(axis: Array, origin: Array, points: Array, normals: Array) -> Primitive | None:
    """A line in the half plane (radius, height), through the middle and across the mean normal."""
    heights, radii, radial = about_axis(points, origin, axis)
    arrows = unit(np.column_stack([np.einsum("ij,ij->i", normals, radial), normals @ axis]))
    radius, height, (out, up) = radii.mean(), heights.mean(), unit(arrows.mean(axis=0))
    slope = -up / out if abs(out) > 1e-3 else np.inf  # growth of the radius along the axis
    if not 1e-4 < abs(slope) < 1e3:
        return None
    apex = origin + (height - radius / slope) * axis
    return Cone(axis if slope > 0 else -axis, apex, float(np.arctan(abs(slope))), float(radius / abs(slope)))


_ABOUT: dict[str, Callable[[Array, Array, Array, Array], Primitive | None]] = {
    "plane": _plane,
    "cylinder": _cylinder,
    "cone": _cone,
    "torus": torus_about,
}
