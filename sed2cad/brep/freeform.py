"""Control nets of free-form patches."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from sed2cad.brep.kernel import Array
from sed2cad.geometry.curves import TURN
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.tensor_patch import DEGREE, greville

Net = tuple[Array, Array, Array, bool]  # control net (nu, nv, 3), knots u, knots v (clamped), whether u closes

_PER_SPAN = 4  # samples per knot span about an axis, where the surface is not a spline by itself
_APART = 1e-6  # of the period: a knot nearer to the seam is on it
_LEAST = 48  # samples around: the cubic through them is 1e-6 of the radius off


def clamped_net(patch: BSplineSurface) -> Net:
    """The exact net of a patch over a plane."""
    return patch.control_points(), patch.knots_u, patch.knots_v, False


def cut_open(patch: NetSurface, seam: float) -> Net:
    """The exact net of a control net; a closed one begins and ends at `seam`, a share of its period."""
    if not patch.closed:
        return patch.net, patch.knots_u, patch.knots_v, False
    period, first = patch.period, patch.domain[0][0] + seam * patch.period
    spans = patch.knots_u[DEGREE : -DEGREE - 1]
    off = np.mod(spans - first, period)
    inner = np.sort(off[(off > _APART * period) & (off < (1 - _APART) * period)])
    knots = np.concatenate([np.zeros(DEGREE + 1), inner, np.full(DEGREE + 1, period)])
    around = BSpline(patch.knots_u, patch.net, DEGREE, extrapolate="periodic")
    at = greville(knots)
    rows = around(first + at)
    rows[-1] = rows[0]
    return make_interp_spline(at, rows, k=DEGREE, t=knots).c, knots, patch.knots_v, True


def around_axis(patch: BSplineSurface, x: Array, points: Array) -> Net:
    """A cubic surface through samples of a patch about an axis, with its seam at direction x.

    Where points (n, 3) of the face leave a gap around the axis, only the part they cover.
    """
    low, high = patch.domain
    shift = float(np.arctan2(x @ patch.frame[1], x @ patch.frame[0]))
    angle = np.mod(patch.base_coordinates(points)[0][:, 0] - shift, TURN)
    gap = 0.5 * (angle.min() + TURN - angle.max())
    closed = gap < 0.05
    first, last = (0.0, TURN) if closed else (angle.min() - gap / 2, angle.max() + gap / 2)
    count_u = max(_LEAST, _PER_SPAN * (len(patch.knots_u) - 7)) + 1
    u = np.linspace(first, last, count_u)
    v = np.linspace(low[1], high[1], _PER_SPAN * (len(patch.knots_v) - 7) + 1)
    grid = np.stack(np.meshgrid(np.mod(u + shift + np.pi, TURN) - np.pi, v, indexing="ij"), axis=-1)
    samples = patch.at(grid.reshape(-1, 2)).reshape(len(u), len(v), 3)
    along_v = make_interp_spline(v, samples, k=3, axis=1)
    rows = np.moveaxis(along_v.c, 0, 1).copy()
    ends = None
    if closed:
        rows[-1] = rows[0]
        slope = CubicSpline(u, rows, bc_type="periodic")(first, 1)
        ends = ([(1, slope)], [(1, slope)])
    along_u = make_interp_spline(u, rows, k=3, bc_type=ends)
    return along_u.c, along_u.t, along_v.t, closed
