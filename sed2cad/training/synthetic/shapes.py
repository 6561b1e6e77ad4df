"""Solids and outlines that the makers build with: thin words around build123d and OCP. Lengths in mm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import cos, hypot, pi, sin, tan
from typing import Any

import numpy as np
from build123d import Axis, Edge, Face, Location, Plane, Solid, Vector, Wire
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.TopAbs import TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_ListOfShape

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]


@dataclass(frozen=True)
class Corner:
    """A corner of an outline, sharp, or cut straight or round at a distance `trim` along both sides."""

    x: float
    y: float
    trim: float = 0.0
    round: bool = True


@dataclass(frozen=True)
class Seat:
    """A flat place for features: a rectangle of 2 x by 2 y around the plane's origin, `depth` of material below."""

    plane: Plane
    x: float
    y: float
    depth: float

    def at(self, x: float, y: float, z: float = 0.0) -> Location:
        """A place in the seat's own coordinates, z away from the material."""
        return Location(self.plane) * Location((x, y, z))


def box(low: Point3, high: Point3) -> Solid:
    """A box between two corners."""
    x, y, z = (b - a for a, b in zip(low, high))
    return Solid.make_box(x, y, z, Plane(origin=low))


def rod(radius: float, height: float, origin: Point3 = (0, 0, 0), axis: Point3 = (0, 0, 1)) -> Solid:
    """A cylinder that stands on `origin`."""
    return Solid.make_cylinder(radius, height, Plane(origin=origin, z_dir=axis))


def taper(low: float, high: float, height: float, origin: Point3 = (0, 0, 0), axis: Point3 = (0, 0, 1)) -> Solid:
    """A truncated cone of two radii that stands on `origin`."""
    return Solid.make_cone(low, high, height, Plane(origin=origin, z_dir=axis))


def outline(corners: Sequence[Corner]) -> Face:
    """A flat face in xy from its corners in order; trims that do not fit are shortened."""
    edges: list[Edge] = []
    ends: list[tuple[Point2, Point2]] = []
    for k, corner in enumerate(corners):
        first, top, second = _bend(corners[k - 1], corner, corners[(k + 1) % len(corners)])
        ends.append((first, second))
        if k:
            edges.append(Edge.make_line(ends[k - 1][1], first))
        if first != second:
            bent = corner.round
            edges.append(Edge.make_three_point_arc(first, top, second) if bent else Edge.make_line(first, second))
    edges.append(Edge.make_line(ends[-1][1], ends[0][0]))
    return Face(Wire(edges))


def _bend(before: Corner, corner: Corner, after: Corner) -> tuple[Point2, Point2, Point2]:
    """Where an outline leaves its side before a corner, the top of the tangent arc, where it joins the next side."""
    here = np.array([corner.x, corner.y])
    back, ahead = np.array([before.x, before.y]) - here, np.array([after.x, after.y]) - here
    lengths = float(np.linalg.norm(back)), float(np.linalg.norm(ahead))
    back, ahead = back / lengths[0], ahead / lengths[1]
    half = 0.5 * float(np.arccos(np.clip(back @ ahead, -1, 1)))
    trim = min(corner.trim, 0.45 * min(lengths))
    if trim < 1e-6 or abs(half - pi / 2) < 0.02:
        return ((corner.x, corner.y),) * 3
    middle = (back + ahead) / np.linalg.norm(back + ahead)
    places = here + trim * back, here + trim * (1 / cos(half) - tan(half)) * middle, here + trim * ahead
    first, top, second = ((float(x), float(y)) for x, y in places)
    return first, top, second


def rectangle(x: float, y: float, trim: float = 0.0, round_: bool = True) -> list[Corner]:
    """The corners of a rectangle of 2 x by 2 y around the origin."""
    return [Corner(sx * x, sy * y, trim, round_) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def regular(sides: int, radius: float, trim: float = 0.0, turn: float = 0.0) -> list[Corner]:
    """The corners of a regular polygon."""
    angles = [turn + 2 * pi * k / sides for k in range(sides)]
    return [Corner(radius * cos(a), radius * sin(a), trim) for a in angles]


def slot(half_length: float, radius: float) -> Face:
    """A slot along x with round ends; `half_length` from the middle to the centre of an end."""
    low, high = (-half_length, -radius), (half_length, -radius)
    right, left = (half_length, radius), (-half_length, radius)
    tips = (half_length + radius, 0.0), (-half_length - radius, 0.0)
    arcs = Edge.make_three_point_arc(high, tips[0], right), Edge.make_three_point_arc(left, tips[1], low)
    return Face(Wire([Edge.make_line(low, high), arcs[0], Edge.make_line(right, left), arcs[1]]))


def disc(radius: float) -> Face:
    """A round face in xy."""
    return Face(Wire([Edge.make_circle(radius)]))


def smooth(points: Sequence[Point2]) -> Edge:
    """An open B-spline through points in xy."""
    return Edge.make_spline([Vector(x, y) for x, y in points])


def blob(points: Sequence[Point2], pieces: bool = False) -> Face:
    """A face in xy inside a smooth closed B-spline through the points, or pieces of three points each with corners."""
    if pieces and len(points) % 2 == 0:
        row = [*points, points[0]]
        return Face(Wire([smooth(row[k : k + 3]) for k in range(0, len(points), 2)]))
    return Face(Wire([Edge.make_spline([Vector(x, y) for x, y in points], periodic=True)]))


def prism(face: Face, height: float, z: float = 0.0) -> Solid:
    """A face in xy, pulled up from z."""
    return Solid.extrude(face.moved(Location((0, 0, z))), Vector(0, 0, height))


def revolve(face: Face) -> Solid:
    """A face in xy turned about the y axis, which becomes z: outlines are (radius, height)."""
    return Solid.revolve(face.rotate(Axis.X, 90), 360, Axis.Z)


def around(count: int, shape: Solid, turn: float = 0.0) -> list[Solid]:
    """Copies of a solid about z, evenly spaced."""
    return [shape.rotate(Axis.Z, turn + 360 * k / count) for k in range(count)]


def cut(part: Solid, tools: Iterable[Solid]) -> Solid:
    """The part without the tools; of several pieces the largest."""
    return _combine(BRepAlgoAPI_Cut(), part, tools)


def join(part: Solid, tools: Iterable[Solid]) -> Solid:
    """The part and the tools in one solid; tools that do not touch are lost."""
    return _combine(BRepAlgoAPI_Fuse(), part, tools)


def common(part: Solid, tools: Iterable[Solid]) -> Solid:
    """Where the part and the tools overlap."""
    return _combine(BRepAlgoAPI_Common(), part, tools)


def _combine(operation: Any, part: Solid, tools: Iterable[Solid]) -> Solid:
    arguments, others = TopTools_ListOfShape(), TopTools_ListOfShape()
    arguments.Append(part.wrapped)
    for tool in tools:
        others.Append(tool.wrapped)
    if others.IsEmpty():
        return part
    operation.SetArguments(arguments)
    operation.SetTools(others)
    operation.Build()
    if not operation.IsDone():
        raise ValueError("a boolean failed")
    unify = ShapeUpgrade_UnifySameDomain(operation.Shape(), True, True, False)
    unify.Build()
    return largest(unify.Shape())


def largest(shape: Any) -> Solid:
    """The largest solid in a shape. Raises ValueError when there is none."""
    solids, explorer = [], TopExp_Explorer(shape, TopAbs_SOLID)
    while explorer.More():
        solids.append(Solid(TopoDS.Solid_s(explorer.Current())))
        explorer.Next()
    if not solids:
        raise ValueError("no solid")
    return solids[0] if len(solids) == 1 else max(solids, key=lambda solid: solid.volume)


def is_sound(part: Solid) -> bool:
    """Whether the part is one valid closed solid with a volume."""
    if part.wrapped is None or part.wrapped.ShapeType() != TopAbs_SOLID:
        return False
    shells = part.shells()
    closed = len(shells) == 1 and shells[0].wrapped.Closed()
    return closed and BRepCheck_Analyzer(part.wrapped).IsValid() and part.volume > 0


def diagonal(part: Solid) -> float:
    """Of the bounding box."""
    return part.bounding_box().diagonal


def apart(points: Sequence[Point2], distance: float) -> list[Point2]:
    """The points that keep a distance from all kept before them."""
    kept: list[Point2] = []
    for x, y in points:
        if all(hypot(x - a, y - b) >= distance for a, b in kept):
            kept.append((x, y))
    return kept
