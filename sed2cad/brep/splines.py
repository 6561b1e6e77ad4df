"""Spline curves: of edges, and of the profiles that are swept."""

from __future__ import annotations

import numpy as np
from OCP.Geom import Geom_BSplineCurve
from OCP.TColgp import TColgp_Array1OfPnt
from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal

from sed2cad.brep.kernel import Array, pnt
from sed2cad.geometry.layout import Placement
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.profile import DEGREE, Profile
from sed2cad.primitives.revolution import Revolution

_SAME = 1e-9  # of a period: a seam this near to a knot is there


def spline_curve(poles: Array, knots: Array, degree: int) -> Geom_BSplineCurve:
    """The curve with poles (n, 3) and clamped knots (n + degree + 1,)."""
    return Geom_BSplineCurve(_poles(poles), *knots_of(knots), degree)


def swept_curve(extrusion: Extrusion, placement: Placement) -> Geom_BSplineCurve:
    """The profile of an extrusion, at the placement's height; a closed one starts at the placement's origin."""
    height = float((placement.origin - extrusion.origin) @ extrusion.direction)
    poles = extrusion.origin + height * extrusion.direction + extrusion.profile.controls @ extrusion.axes
    curve = _curve(extrusion.profile, poles)
    if extrusion.profile.closed:
        seam = float(extrusion.profile.foot(extrusion.flat(placement.origin[None]))[0])
        curve.SetOrigin(seam, _SAME * float(np.ptp(extrusion.profile.ends)))
    return curve


def meridian_of(revolution: Revolution, placement: Placement) -> Geom_BSplineCurve:
    """The profile of a surface of revolution in the half plane of the placement's seam."""
    controls = revolution.profile.controls
    poles = revolution.origin + controls[:, :1] * placement.x + controls[:, 1:] * revolution.axis
    return _curve(revolution.profile, poles)


def _curve(profile: Profile, poles: Array) -> Geom_BSplineCurve:
    """The profile in space, its controls being at poles (n, 3): periodic where it is closed."""
    if not profile.closed:
        return spline_curve(poles, profile.knots, DEGREE)
    inner = profile.knots[DEGREE:-DEGREE]
    return Geom_BSplineCurve(_poles(poles[:-DEGREE]), *knots_of(inner), DEGREE, True)


def _poles(points: Array) -> TColgp_Array1OfPnt:
    poles = TColgp_Array1OfPnt(1, len(points))
    for k, point in enumerate(points, start=1):
        poles.SetValue(k, pnt(point))
    return poles


def knots_of(knots: Array) -> tuple[TColStd_Array1OfReal, TColStd_Array1OfInteger]:
    """Different knots and how often each occurs; what differs by rounding only is the same."""
    starts = np.flatnonzero(np.diff(knots, prepend=-np.inf) > 1e-9 * (knots[-1] - knots[0]))
    times = np.diff(np.append(starts, len(knots)))
    found, count = TColStd_Array1OfReal(1, len(starts)), TColStd_Array1OfInteger(1, len(starts))
    for k, (value, often) in enumerate(zip(knots[starts], times), start=1):
        found.SetValue(k, float(value))
        count.SetValue(k, int(often))
    return found, count
