"""Faces with a pole inside: the top of a sphere, the tip of a cone.

ShapeFix makes their seams by itself for clean rings, but once left a cone open whose ring of six edges was a
little off its surface. So the seam from ring to pole and the degenerated edge at the pole are made here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.Geom import Geom_Circle, Geom_Curve, Geom_Line
from OCP.Geom2d import Geom2d_Line
from OCP.gp import gp_Ax2, gp_Dir2d, gp_Pnt2d
from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Vertex

from sed2cad.brep.kernel import Array, direction, pnt
from sed2cad.brep.splines import meridian_of
from sed2cad.geometry.curves import TURN
from sed2cad.geometry.layout import Placement
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.sphere import Sphere

_TOLERANCE = 1e-7


@dataclass(frozen=True)
class _Meridian:
    """The seam line of a surface; its parameter is the surface's v."""

    curve: Geom_Curve
    at: float  # v of the ring's vertex
    pole: float  # v of the pole
    tip: Array  # (3,): the pole


def cap_edges(
    face: TopoDS_Face, primitive: Primitive, placement: Placement, vertex: TopoDS_Vertex, point: Array
) -> list[TopoDS_Shape]:
    """The oriented edges that lead from the ring's vertex at `point` (3,) to the pole and back again.

    `face` already carries the surface. They follow the ring in its wire.
    """
    meridian = _meridian(primitive, placement, point)
    builder, tip = BRep_Builder(), TopoDS_Vertex()
    builder.MakeVertex(tip, pnt(meridian.tip), _TOLERANCE)
    up = meridian.pole > meridian.at
    low, high = (meridian.at, meridian.pole) if up else (meridian.pole, meridian.at)
    seam = TopoDS_Edge()
    builder.MakeEdge(seam, meridian.curve, _TOLERANCE)
    builder.UpdateEdge(seam, _upright(TURN), _upright(0.0), face, _TOLERANCE)
    builder.Range(seam, low, high)
    builder.Add(seam, (vertex if up else tip).Oriented(TopAbs_FORWARD))
    builder.Add(seam, (tip if up else vertex).Oriented(TopAbs_REVERSED))
    point_edge = TopoDS_Edge()
    builder.MakeEdge(point_edge)
    around = Geom2d_Line(gp_Pnt2d(0.0, meridian.pole), gp_Dir2d(1.0, 0.0))
    builder.UpdateEdge(point_edge, around, face, _TOLERANCE)
    builder.Degenerated(point_edge, True)
    builder.Range(point_edge, 0.0, TURN)
    builder.Add(point_edge, tip.Oriented(TopAbs_FORWARD))
    builder.Add(point_edge, tip.Oriented(TopAbs_REVERSED))
    there, back = (TopAbs_FORWARD, TopAbs_REVERSED) if up else (TopAbs_REVERSED, TopAbs_FORWARD)
    return [seam.Oriented(there), point_edge.Oriented(back), seam.Oriented(back)]


def _upright(u: float) -> Geom2d_Line:
    """The line of constant u in the surface's parameters."""
    return Geom2d_Line(gp_Pnt2d(u, 0.0), gp_Dir2d(0.0, 1.0))


def _meridian(primitive: Primitive, placement: Placement, point: Array) -> _Meridian:
    origin, z, x = placement.origin, placement.z, placement.x
    height = float((point - origin) @ z)
    assert placement.pole is not None
    if isinstance(primitive, Sphere):
        pole = math.pi / 2 if placement.pole.up else -math.pi / 2
        circle = Geom_Circle(gp_Ax2(pnt(origin), direction(np.cross(x, z)), direction(x)), primitive.radius)
        at = math.atan2(height, float((point - origin) @ x))
        return _Meridian(circle, at, pole, origin + math.copysign(primitive.radius, pole) * z)
    if isinstance(primitive, Revolution):
        profile = primitive.profile
        at = float(profile.foot(primitive.meridian(point[None]))[0])
        end = profile.ends[int(placement.pole.up)]
        tip = primitive.origin + float(profile.at(np.array([end]))[0, 1]) * z
        return _Meridian(meridian_of(primitive, placement), at, end, tip)
    assert isinstance(primitive, Cone)
    sin, cos = math.sin(primitive.half_angle), math.cos(primitive.half_angle)
    radius = float((origin - primitive.apex) @ z) * sin / cos
    line = Geom_Line(pnt(origin + radius * x), direction(sin * x + cos * z))
    return _Meridian(line, height / cos, -radius / sin, primitive.apex)
