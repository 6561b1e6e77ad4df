"""Free-form patches continued beyond their borders, so that edges and corners with their neighbours lie on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline

from sed2cad.geometry.curves import Array
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.revolution import Revolution, reaching
from sed2cad.primitives.tensor_patch import DEGREE, greville

_REACH = 0.04  # unit frame: by how much a patch grows on each side
_MOST_OF_EXTENT = 0.5  # that a control net grows by: it may be a narrow strip


def widened(fitted: FittedPatch) -> FittedPatch:
    """The fitted patch, a free-form one continued straight on beyond its borders."""
    primitive = fitted.primitive
    if isinstance(primitive, NetSurface):
        return replace(fitted, primitive=extended_net(primitive, _REACH))
    if isinstance(primitive, BSplineSurface):
        return replace(fitted, primitive=extended(primitive, _REACH))
    if isinstance(primitive, Extrusion) and not primitive.profile.closed:
        profile = primitive.profile.longer(_REACH, _REACH)
        return replace(fitted, primitive=replace(primitive, profile=profile))
    if isinstance(primitive, Revolution) and not primitive.profile.closed:
        return replace(fitted, primitive=replace(primitive, profile=reaching(primitive.profile, _REACH)))
    return fitted


def extended(patch: BSplineSurface, reach: float) -> BSplineSurface:
    """The patch continued by `reach` (lengths) on each side, with the slope of its border.

    About an axis it grows along the axis only. Within the old borders it changes by what a cubic makes of the
    change of curvature there.
    """
    flat = patch.base == "plane"
    knots_u = _longer(patch.knots_u, reach) if flat else patch.knots_u
    knots_v = _longer(patch.knots_v, reach)
    if not flat:
        return replace(patch, knots_v=knots_v, heights=_along_v(patch, knots_v))
    u, v = _abscissae(knots_u), _abscissae(knots_v)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    heights = _continued(patch, grid).reshape(len(u), len(v))
    columns = make_interp_spline(u, heights, k=DEGREE, t=knots_u).c
    rows = make_interp_spline(v, columns.T, k=DEGREE, t=knots_v).c
    return replace(patch, knots_u=knots_u, knots_v=knots_v, heights=np.ascontiguousarray(rows.T))


def extended_net(patch: NetSurface, reach: float) -> NetSurface:
    """The same for a control net, by `reach` or half its extent, whichever is less; closed ones grow along v only."""
    low, high = patch.domain
    reach_u, reach_v = np.minimum(reach, _MOST_OF_EXTENT * (high - low))
    knots_u = patch.knots_u if patch.closed else _longer(patch.knots_u, float(reach_u))
    knots_v = _longer(patch.knots_v, float(reach_v))
    rows = _net_along(patch.knots_v, np.swapaxes(patch.net, 0, 1), knots_v)
    net = np.swapaxes(rows, 0, 1)
    net = net if patch.closed else _net_along(patch.knots_u, net, knots_u)
    return replace(patch, knots_u=knots_u, knots_v=knots_v, net=np.ascontiguousarray(net))


def _net_along(knots: Array, net: Array, longer: Array) -> Array:
    """Control points (m, k, 3) over longer knots of a curve of rows with control points (n, k, 3), straight on."""
    at = _abscissae(longer)
    inside = np.clip(at, knots[DEGREE], knots[-DEGREE - 1])
    curve = BSpline(knots, net, DEGREE)
    values = curve(inside) + (at - inside)[:, None, None] * curve(inside, 1)
    return np.asarray(make_interp_spline(at, values, k=DEGREE, t=longer).c)


def _longer(knots: Array, reach: float) -> Array:
    """Clamped knots with two more spans on each side."""
    low, high = float(knots[DEGREE]), float(knots[-DEGREE - 1])
    inner = knots[DEGREE + 1 : -DEGREE - 1]
    start, end = low - reach, high + reach
    more = [low - reach / 2, low], [high, high + reach / 2]
    return np.concatenate([[start] * (DEGREE + 1), more[0], inner, more[1], [end] * (DEGREE + 1)])


def _abscissae(knots: Array) -> Array:
    """Greville abscissae (n,), kept within the knots in spite of rounding."""
    return np.clip(greville(knots), knots[DEGREE], knots[-DEGREE - 1])


def _continued(patch: BSplineSurface, uv: Array) -> Array:
    """Heights (n,) at parameters (n, 2), straight on outside the domain."""
    low, high = patch.domain
    inside = np.clip(uv, low, high)
    over = uv - inside
    spline = NdBSpline((patch.knots_u, patch.knots_v), patch.heights, DEGREE)
    slopes = np.column_stack([spline(inside, nu=(1, 0)), spline(inside, nu=(0, 1))])
    return np.asarray(spline(inside) + np.einsum("ij,ij->i", over, slopes))


def _along_v(patch: BSplineSurface, knots_v: Array) -> Array:
    """Control radii (nu, m) of a patch about an axis over longer knots along it, row by row."""
    v = _abscissae(knots_v)
    low, high = patch.knots_v[DEGREE], patch.knots_v[-DEGREE - 1]
    inside = np.clip(v, low, high)
    along = NdBSpline((patch.knots_v,), patch.heights.T, DEGREE)
    values = along(inside[:, None]) + (v - inside)[:, None] * along(inside[:, None], nu=(1,))
    return np.ascontiguousarray(make_interp_spline(v, values, k=DEGREE, t=knots_v).c.T)
