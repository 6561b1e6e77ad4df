"""Fit a control net: penalised least squares over base parameters that follow the surface.

Parameters of the points and control points are found in turn (Hoschek 1988, Intrinsic parametrization for
approximation); spans whose points are far off are split.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.tensor_patch import DEGREE, greville, tensor_basis
from sed2cad.primitives.unroll import Unrolled

FINEST = 1e-5  # rms that nobody needs to go below, unit frame
_SMOOTHING = 1e-7  # weight of the second differences against the mean weight of a control point
_NOISY = 1e-3  # the same for points with noise
_RULED = 0.1  # the same across a long strip at first, until the parameters fit it
_STRIP = 8.0  # widths
_STRAIGHT = 1e-3  # the same where there are no points
_LONELY = 4.0  # spacings of the parameters to the nearest points where there are none
_TIE = 1e-10  # of all control points to where they are
_MARGIN = 4.0  # spacings of the points, left around them
_MOST_MARGIN = 0.1  # of the extent
_SLICE = 2.0  # lengths of a first span, in widths
_MOST_FIRST = 128  # spans along u at first
_ROUNDS = 12  # of splits
_CORRECTIONS = 4  # of the parameters between two splits, at most
_FOOT_STEPS = 3  # towards the feet of the points, each time
_GAIN = 0.85  # a correction must bring the rms down to this for another one
_LEAST_GAIN = 0.95  # of a round of splits
_PER_SPAN = 4  # points of a span that may be split
_POINTS_PER_CONTROL = 2.5


@dataclass(frozen=True)
class Grid:
    """Breaks of the parameters."""

    u: Array  # (spans + 1,)
    v: Array
    closed: bool
    smoothing: float  # weight of the second differences against the mean weight of a control point

    @property
    def knots(self) -> tuple[Array, Array]:
        """Cubic knots with full ends, or periodic ones."""
        full = np.concatenate([np.repeat(self.v[:1], DEGREE), self.v, np.repeat(self.v[-1:], DEGREE)])
        if not self.closed:
            return np.concatenate([np.repeat(self.u[:1], DEGREE), self.u, np.repeat(self.u[-1:], DEGREE)]), full
        period = self.u[-1] - self.u[0]
        return np.concatenate([self.u[-DEGREE - 1 : -1] - period, self.u, self.u[1 : DEGREE + 1] + period]), full

    @property
    def shape(self) -> tuple[int, int]:
        """Different control points along u and v."""
        return len(self.u) - 1 + (0 if self.closed else DEGREE), len(self.v) - 1 + DEGREE


@dataclass(frozen=True)
class NetFit:
    """A net and the points it was fitted to."""

    surface: NetSurface
    grid: Grid  # of its knots
    uv: Array  # (n, 2) parameters of the points
    rms: float

    @property
    def controls(self) -> int:
        """Different control points."""
        nu, nv = self.surface.net.shape[:2]
        return (nu - DEGREE if self.surface.closed else nu) * nv


def fit_net(points: Array, start: Unrolled, noise: float) -> NetFit | None:
    """The coarsest net through points (n, 3) to within the noise that the splits lead to; None for too few points."""
    grid = _first_grid(start, len(points), _NOISY if noise > 0 else _SMOOTHING)
    if grid is None:
        return None
    current = _solved(points, start.uv, grid, _RULED if _is_strip(start) else 0.0)
    if _is_strip(start):
        for _ in range(2):
            current = _solved(points, _with_feet(points, current).uv, grid, _RULED)
    best = current = _corrected(points, current)
    patience = 1
    for _ in range(_ROUNDS):
        if best.rms <= max(1.02 * noise, FINEST) or patience < 0:
            break
        following = _split(points, current, noise)
        if following is None:
            break
        current = _corrected(points, following)
        patience = 1 if current.rms < _LEAST_GAIN * best.rms else patience - 1
        best = min(best, current, key=lambda fit: fit.rms)
    return best


def stiffened(points: Array, fit: NetFit, smoothing: float) -> NetFit:
    """The net of the same knots that is smoother."""
    return _corrected(points, _solved(points, fit.uv, replace(fit.grid, smoothing=smoothing)))


def _first_grid(start: Unrolled, count: int, smoothing: float) -> Grid | None:
    """Few spans, about as long as wide along u."""
    low, high = start.uv.min(axis=0), start.uv.max(axis=0)
    size = np.maximum(high - low, 1e-9)
    margin = np.minimum(_MARGIN * float(np.sqrt(size[0] * size[1] / count)), _MOST_MARGIN * size)
    ratio = size[0] / max(size[1], 1e-12) / _SLICE
    spans = int(np.clip(round(ratio), 4 if start.period else 1, min(_MOST_FIRST, count // (8 * (DEGREE + 1)))))
    if spans < 1 or count < 2 * (DEGREE + 1) ** 2:
        return None
    across = 2 if start.period else 1
    if start.period:
        spans = max(spans, 6)
        u = np.linspace(0.0, start.period, spans + 1)
    else:
        u = np.linspace(low[0] - margin[0], high[0] + margin[0], spans + 1)
    along = max(across, min(round(_SLICE * size[1] / size[0]), 24)) if start.period else 1
    return Grid(u, np.linspace(low[1] - margin[1], high[1] + margin[1], along + 1), start.period > 0, smoothing)


def _is_strip(start: Unrolled) -> bool:
    """Whether a sheet is so long that it is about straight across."""
    length, width = np.ptp(start.uv, axis=0)
    return bool(length > _STRIP * width)


def _solved(points: Array, uv: Array, grid: Grid, across: float = 0.0) -> NetFit:
    """Least squares for the control points with the parameters (n, 2) fixed; smoothed by `across` at least along v."""
    knots_u, knots_v = grid.knots
    count_u, count_v = grid.shape
    design = tensor_basis(uv, knots_u, knots_v, count_u, count_v)
    matrix = (design.T @ design).tocsc()
    mean = float(matrix.diagonal().mean())
    unknowns = count_u * count_v
    penalty = mean * (_roughness(grid, _lonely(uv, grid), across) + diags_array(np.full(unknowns, _TIE)))
    net = splu((matrix + penalty).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
        design.T @ points
    )
    gap = points - design @ net
    net = net.reshape(count_u, count_v, 3)
    if grid.closed:
        net = np.concatenate([net, net[:DEGREE]])
    surface = NetSurface(grid.closed, knots_u, knots_v, net)
    return NetFit(surface, grid, uv, float(np.sqrt(np.mean(np.einsum("ij,ij->i", gap, gap)))))


def _corrected(points: Array, fit: NetFit) -> NetFit:
    """Parameters moved to the feet of the points and the net solved for again, as long as it helps."""
    fit = _with_feet(points, fit)
    for _ in range(_CORRECTIONS):
        if fit.rms <= FINEST:
            break
        following = _with_feet(points, _solved(points, fit.uv, fit.grid))
        gained = following.rms < _GAIN * fit.rms
        fit = min(following, fit, key=lambda some: some.rms)
        if not gained:
            break
    return fit


def _with_feet(points: Array, fit: NetFit) -> NetFit:
    """The same net with the points' parameters at their feet, and the rms distance."""
    uv = fit.surface.foot(points, fit.uv, _FOOT_STEPS)
    gap = points - fit.surface.at(uv)
    return replace(fit, uv=uv, rms=float(np.sqrt(np.mean(np.einsum("ij,ij->i", gap, gap)))))


def _split(points: Array, fit: NetFit, noise: float) -> NetFit | None:
    """The net with the bad spans of one direction (or of both) split; of these what gains most per control point."""
    gap = points - fit.surface.at(fit.uv)
    square = np.einsum("ij,ij->i", gap, gap)
    grid = fit.grid
    finer_u = _halved(grid.u, fit.uv[:, 0], square, noise)
    finer_v = _halved(grid.v, fit.uv[:, 1], square, noise)
    grids = [replace(grid, u=finer_u), replace(grid, v=finer_v), replace(grid, u=finer_u, v=finer_v)]
    now = np.prod(grid.shape)
    trials = [
        _solved(points, fit.uv, finer)
        for finer in grids
        if np.prod(finer.shape) > now and np.prod(finer.shape) * _POINTS_PER_CONTROL <= len(points)
    ]
    if not trials:
        return None

    def worth(trial: NetFit) -> float:
        return float(np.log(max(fit.rms, 1e-300) / max(trial.rms, noise, 1e-300)) / np.log(trial.controls / now))

    return max(trials, key=worth)


def _halved(breaks: Array, at: Array, square: Array, noise: float) -> Array:
    """Breaks with a new one amid each span whose points, at parameters (n,), have large squared gaps (n,)."""
    span = np.clip(np.searchsorted(breaks, at, side="right") - 1, 0, len(breaks) - 2)
    count = np.bincount(span, minlength=len(breaks) - 1)
    mean = np.bincount(span, square, len(breaks) - 1) / np.maximum(count, 1)
    limit = max(max(noise, 0.7 * FINEST) ** 2, 0.02 * float(square.mean()))
    bad = (mean > limit) & (count >= 2 * _PER_SPAN)
    return np.sort(np.concatenate([breaks, (breaks[:-1] + breaks[1:])[bad] / 2]))


def _roughness(grid: Grid, lonely: NDArray[np.bool_], across: float) -> csc_array:
    """Weighted sum of squared second differences of the control points along u and v, as a matrix.

    The net goes straight on where control points (unknowns,) are lonely.
    """
    (knots_u, knots_v), (count_u, count_v) = grid.knots, grid.shape
    total = csc_array((count_u * count_v, count_u * count_v))
    for smoothing, second in (
        (grid.smoothing, kron(_second_differences(knots_u, count_u, grid.closed), eye_array(count_v))),
        (max(across, grid.smoothing), kron(eye_array(count_u), _second_differences(knots_v, count_v, False))),
    ):
        second = csr_array(second)
        alone = np.maximum.reduceat(lonely[second.indices], second.indptr[:-1])
        weight = np.where(alone, max(_STRAIGHT, smoothing), smoothing)
        total = total + second.T @ diags_array(weight) @ second
    return csc_array(total)


def _lonely(uv: Array, grid: Grid) -> NDArray[np.bool_]:
    """Whether no parameters (n, 2) are near the place of a control point (unknowns,)."""
    tree = cKDTree(uv)
    spacing = float(np.median(tree.query(uv[:: max(1, len(uv) // 300)], 2)[0][:, 1]))
    (knots_u, knots_v), count_u = grid.knots, grid.shape[0]
    u, v = greville(knots_u)[:count_u], greville(knots_v)
    u = np.mod(u - grid.u[0], grid.u[-1] - grid.u[0]) + grid.u[0] if grid.closed else u
    places = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(tree.query(places)[0] > _LONELY * spacing)


def _second_differences(knots: Array, count: int, closed: bool) -> csr_array:
    """Second divided differences (m, count) in units of the local spacing."""
    at = greville(knots)
    first = np.arange(count if closed else count - 2)
    before, after = at[first + 1] - at[first], at[first + 2] - at[first + 1]
    both = np.maximum(before + after, 1e-300)
    rows = np.repeat(first, 3)
    columns = (first[:, None] + np.arange(3)) % count
    values = 2 * np.column_stack([after / both, -np.ones(len(first)), before / both])
    return csr_array((values.ravel(), (rows, columns.ravel())), shape=(len(first), count))
