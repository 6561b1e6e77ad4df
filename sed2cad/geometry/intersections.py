"""Intersections of two primitives that are a line, a circle or an ellipse, straight from the parameters.

Surfaces of revolution about one axis are cut in their half-plane (height, radius): a plane, cylinder or
cone is a straight profile there, a sphere or torus a round one. Tangent surfaces touch in one profile
point; where fitted ones miss each other by a hair, the point midway is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sed2cad.geometry.curves import Array, Circle, Curve, Ellipse, Line
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.coaxial import axis_of
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame, unit

_ANGLE = 1e-6  # radians: directions closer than this are parallel
_LENGTH = 1e-6  # unit frame: points closer than this coincide
_NEARLY = 5e-3  # radians and unit frame: a straight pipe that goes on from a bend


@dataclass(frozen=True)
class _Straight:
    """The profile n . (height, radius) = offset."""

    normal: Array  # (2,), unit
    offset: float


@dataclass(frozen=True)
class _Round:
    """The profile circle about centre (height, radius)."""

    centre: Array  # (2,)
    radius: float


_Profile = _Straight | _Round


def exact_intersections(a: Primitive, b: Primitive, tangent: bool) -> list[Curve]:
    """All lines, circles and ellipses that are the common curve of a and b; empty where it has no such form.

    `tangent` asks for the curve where the surfaces touch instead of where they cross.
    """
    if isinstance(b, Plane) and not isinstance(a, Plane):
        a, b = b, a
    if isinstance(a, Plane):
        found = _with_plane(a, b, tangent)
        if found:
            return found
    if tangent:
        for one, other in ((a, b), (b, a)):
            if isinstance(one, Cylinder) and isinstance(other, Torus):
                found = _cylinder_into_tube(one, other)
                if found:
                    return found
    return _coaxial(a, b, tangent)


def _with_plane(plane: Plane, other: Primitive, tangent: bool) -> list[Curve]:
    """Plane sections that need no common axis."""
    if isinstance(other, Plane):
        return [] if tangent else _plane_plane(plane, other)
    if isinstance(other, Cylinder):
        slope = float(plane.normal_vector @ other.axis)
        if abs(slope) < _ANGLE:
            return _plane_along_cylinder(plane, other, tangent)
        if abs(slope) < 1 - _ANGLE**2 and not tangent:
            return [_plane_across_cylinder(plane, other, slope)]
    if isinstance(other, Torus) and not tangent:
        return _plane_through_torus_axis(plane, other)
    return []


def _plane_plane(a: Plane, b: Plane) -> list[Curve]:
    direction = np.cross(a.normal_vector, b.normal_vector)
    if np.linalg.norm(direction) < 1e-3:
        return []
    direction = unit(direction)
    matrix = np.vstack([a.normal_vector, b.normal_vector, direction])
    return [Line(np.linalg.solve(matrix, np.array([a.offset, b.offset, 0.0])), direction)]


def _plane_along_cylinder(plane: Plane, cylinder: Cylinder, tangent: bool) -> list[Curve]:
    """One or two lines parallel to the axis."""
    normal = unit(plane.normal_vector - (plane.normal_vector @ cylinder.axis) * cylinder.axis)
    height = float(plane.distance(cylinder.point[None])[0])  # of the axis over the plane
    if tangent:
        towards = -np.sign(height) * normal
        reach = (abs(height) + cylinder.radius) / 2
        return [Line(cylinder.point + reach * towards, cylinder.axis)]
    if abs(height) >= cylinder.radius:
        return []
    foot = cylinder.point - height * normal
    half = np.sqrt(cylinder.radius**2 - height**2) * np.cross(normal, cylinder.axis)
    return [Line(foot + half, cylinder.axis), Line(foot - half, cylinder.axis)]


def _plane_across_cylinder(plane: Plane, cylinder: Cylinder, slope: float) -> Ellipse:
    centre = cylinder.point - plane.distance(cylinder.point[None])[0] / slope * cylinder.axis
    x = unit(cylinder.axis - slope * plane.normal_vector)
    return Ellipse(centre, plane.normal_vector, x, cylinder.radius / abs(slope), cylinder.radius)


def _plane_through_torus_axis(plane: Plane, torus: Torus) -> list[Curve]:
    """The two circles of the tube."""
    if abs(plane.normal_vector @ torus.axis) > _ANGLE or abs(plane.distance(torus.centre[None])[0]) > _LENGTH:
        return []
    out = torus.major_radius * unit(np.cross(plane.normal_vector, torus.axis))
    centres = (torus.centre + out, torus.centre - out)
    return [Circle(centre, plane.normal_vector, torus.axis, torus.minor_radius) for centre in centres]


def _cylinder_into_tube(cylinder: Cylinder, torus: Torus) -> list[Curve]:
    """The circle where a pipe bend ends and the straight pipe begins.

    On top of the tube the normals agree all along, so nothing but the axes tells where the circle is: they
    are taken at their word even when they are not quite tangent.
    """
    offset = torus.centre - cylinder.point
    foot = cylinder.point + float(offset @ cylinder.axis) * cylinder.axis
    out = foot - torus.centre
    misfits = (
        float(cylinder.axis @ torus.axis),
        float(np.linalg.norm(out)) - torus.major_radius,
        float(out @ torus.axis),
        cylinder.radius - torus.minor_radius,
    )
    if np.abs(misfits).max() > _NEARLY:
        return []
    return [Circle(foot, cylinder.axis, unit(out), (cylinder.radius + torus.minor_radius) / 2)]


def _coaxial(a: Primitive, b: Primitive, tangent: bool) -> list[Curve]:
    """Circles about the common axis of two surfaces of revolution."""
    common = _common_axis(a, b)
    if common is None:
        return []
    origin, axis = common
    first, second = _profile(a, origin, axis), _profile(b, origin, axis)
    if first is None or second is None:
        return []
    points = _touching(first, second) if tangent else _crossing(first, second)
    x = tangent_frame(axis)[0]
    found: list[Curve] = [Circle(origin + h * axis, axis, x, float(r)) for h, r in points if r > _LENGTH]
    return found if tangent else [circle for circle in found if _lies_on(circle, a) and _lies_on(circle, b)]


def _lies_on(circle: Curve, primitive: Primitive) -> bool:
    """False for the part of a profile that the primitive lacks (a cone's other nappe)."""
    return bool(np.abs(primitive.distance(circle.at(np.array([0.0, 2.0, 4.0])))).max() < 100 * _LENGTH)


def _common_axis(a: Primitive, b: Primitive) -> tuple[Array, Array] | None:
    """Point and direction of the axis about which both are surfaces of revolution, were they so."""
    axis = axis_of(a) or axis_of(b)
    if axis is not None:
        return axis[1], axis[0]
    if isinstance(a, Plane) and isinstance(b, Sphere):
        return b.centre, a.normal_vector
    if isinstance(a, Sphere) and isinstance(b, Sphere):
        between = b.centre - a.centre
        return (a.centre, unit(between)) if np.linalg.norm(between) > _LENGTH else None
    return None


def _profile(primitive: Primitive, origin: Array, axis: Array) -> _Profile | None:
    """The curve that turns about the axis; None where the primitive is no surface of revolution about it."""
    if isinstance(primitive, Plane):
        level = float(primitive.normal_vector @ axis)
        if abs(level) < 1 - _ANGLE**2:
            return None
        height = -float(primitive.distance(origin[None])[0]) * np.sign(level)
        return _Straight(np.array([1.0, 0.0]), height)
    if isinstance(primitive, Sphere):
        height, aside = _along_and_aside(primitive.centre, origin, axis)
        return None if aside > _LENGTH else _Round(np.array([height, 0.0]), primitive.radius)
    own = axis_of(primitive)
    if own is None or np.linalg.norm(np.cross(own[0], axis)) > _ANGLE:
        return None
    height, aside = _along_and_aside(own[1], origin, axis)
    if aside > _LENGTH:
        return None
    if isinstance(primitive, Cylinder):
        return _Straight(np.array([0.0, 1.0]), primitive.radius)
    if isinstance(primitive, Cone):
        way = np.sign(float(primitive.axis @ axis))
        normal = np.array([-way * np.sin(primitive.half_angle), np.cos(primitive.half_angle)])
        return _Straight(normal, float(normal[0] * height))
    assert isinstance(primitive, Torus)
    return _Round(np.array([height, primitive.major_radius]), primitive.minor_radius)


def _along_and_aside(point: Array, origin: Array, axis: Array) -> tuple[float, float]:
    """Position along the axis and distance from it."""
    offset = point - origin
    along = float(offset @ axis)
    return along, float(np.linalg.norm(offset - along * axis))


def _crossing(a: _Profile, b: _Profile) -> list[Array]:
    """Points (2,) common to two profiles."""
    if isinstance(a, _Straight) and isinstance(b, _Straight):
        matrix = np.vstack([a.normal, b.normal])
        if abs(np.linalg.det(matrix)) < 1e-3:
            return []
        return [np.linalg.solve(matrix, np.array([a.offset, b.offset]))]
    if isinstance(a, _Round) and isinstance(b, _Round):
        between = b.centre - a.centre
        span = float(np.linalg.norm(between))
        if span < _LENGTH:
            return []
        offset = (span**2 + a.radius**2 - b.radius**2) / (2 * span)
        chord = _Straight(between / span, offset + float(between @ a.centre) / span)
        return _crossing(chord, a)
    if isinstance(a, _Round):
        a, b = b, a
    assert isinstance(a, _Straight) and isinstance(b, _Round)
    depth = float(a.normal @ b.centre) - a.offset
    if abs(depth) >= b.radius:
        return []
    foot = b.centre - depth * a.normal
    half = np.sqrt(b.radius**2 - depth**2) * np.array([-a.normal[1], a.normal[0]])
    return [foot + half, foot - half]


def _touching(a: _Profile, b: _Profile) -> list[Array]:
    """The points (2,) midway between two profiles where their normals agree."""
    if isinstance(a, _Straight) and isinstance(b, _Straight):
        return []
    if isinstance(a, _Round) and isinstance(b, _Round):
        between = b.centre - a.centre
        span = float(np.linalg.norm(between))
        if span < _LENGTH:
            return []
        way = between / span
        inside = span < max(a.radius, b.radius)  # one within the other
        larger_a = a.radius >= b.radius
        first = a.centre + (way if not inside or larger_a else -way) * a.radius
        second = b.centre + (-way if not inside or not larger_a else way) * b.radius
        return [(first + second) / 2]
    if isinstance(a, _Round):
        a, b = b, a
    assert isinstance(a, _Straight) and isinstance(b, _Round)
    depth = float(a.normal @ b.centre) - a.offset
    towards = -np.sign(depth) * a.normal
    return [b.centre + (abs(depth) + b.radius) / 2 * towards]
