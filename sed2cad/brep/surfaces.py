"""From primitives and curves to OCC geometry. The natural normal of each surface is the primitive's."""

from __future__ import annotations

import math

from OCP.Geom import (
    Geom_BSplineSurface,
    Geom_Circle,
    Geom_ConicalSurface,
    Geom_Curve,
    Geom_CylindricalSurface,
    Geom_Ellipse,
    Geom_Line,
    Geom_Plane,
    Geom_SphericalSurface,
    Geom_Surface,
    Geom_SurfaceOfLinearExtrusion,
    Geom_SurfaceOfRevolution,
    Geom_ToroidalSurface,
)
from OCP.gp import gp_Ax1, gp_Ax2
from OCP.TColgp import TColgp_Array2OfPnt

from sed2cad.brep.freeform import around_axis, clamped_net, cut_open
from sed2cad.brep.kernel import Array, axes, direction, pnt
from sed2cad.brep.splines import knots_of, meridian_of, spline_curve, swept_curve
from sed2cad.geometry.curves import Circle, Curve, Ellipse, Interpolated, Line
from sed2cad.geometry.layout import Placement
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus


def surface_of(primitive: Primitive, placement: Placement, points: Array) -> Geom_Surface:
    """The OCC surface of a primitive at a placement; points (n, 3) of the face bound free-form surfaces."""
    frame = axes(placement.origin, placement.z, placement.x)
    if isinstance(primitive, Plane):
        return Geom_Plane(frame)
    if isinstance(primitive, Cylinder):
        return Geom_CylindricalSurface(frame, primitive.radius)
    if isinstance(primitive, Cone):
        height = float((placement.origin - primitive.apex) @ primitive.axis)
        return Geom_ConicalSurface(frame, primitive.half_angle, height * math.tan(primitive.half_angle))
    if isinstance(primitive, Sphere):
        return Geom_SphericalSurface(frame, primitive.radius)
    if isinstance(primitive, Torus):
        return Geom_ToroidalSurface(frame, primitive.major_radius, primitive.minor_radius)
    if isinstance(primitive, NetSurface):
        return _bspline_surface(*cut_open(primitive, placement.seam))
    if isinstance(primitive, BSplineSurface):
        net = clamped_net(primitive) if primitive.base == "plane" else around_axis(primitive, placement.x, points)
        return _bspline_surface(*net)
    if isinstance(primitive, Extrusion):
        return Geom_SurfaceOfLinearExtrusion(swept_curve(primitive, placement), direction(primitive.direction))
    if isinstance(primitive, Revolution):
        axis = gp_Ax1(pnt(primitive.origin), direction(primitive.axis))
        return Geom_SurfaceOfRevolution(meridian_of(primitive, placement), axis)
    raise TypeError(f"no surface for a {primitive.kind}")


def curve_of(curve: Curve) -> Geom_Curve:
    """The OCC curve with the same parameter."""
    if isinstance(curve, Line):
        return Geom_Line(pnt(curve.origin), direction(curve.direction))
    if isinstance(curve, Circle):
        return Geom_Circle(gp_Ax2(pnt(curve.centre), direction(curve.axis), direction(curve.x)), curve.radius)
    if isinstance(curve, Ellipse):
        frame = gp_Ax2(pnt(curve.centre), direction(curve.axis), direction(curve.x))
        return Geom_Ellipse(frame, curve.major, curve.minor)
    assert isinstance(curve, Interpolated)
    spline = curve.spline
    return spline_curve(spline.c, spline.t, spline.k)


def _bspline_surface(net: Array, knots_u: Array, knots_v: Array, closed_u: bool) -> Geom_BSplineSurface:
    """A cubic surface from its control net (nu, nv, 3) and clamped knots."""
    poles = TColgp_Array2OfPnt(1, net.shape[0], 1, net.shape[1])
    for i in range(net.shape[0]):
        for j in range(net.shape[1]):
            poles.SetValue(i + 1, j + 1, pnt(net[i, j]))
    u, times_u = knots_of(knots_u)
    v, times_v = knots_of(knots_v)
    surface = Geom_BSplineSurface(poles, u, v, times_u, times_v, 3, 3)
    if closed_u:
        surface.SetUPeriodic()
    return surface
