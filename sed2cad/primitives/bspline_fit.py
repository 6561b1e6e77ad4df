"""Fit the freeform patch: penalised least squares, knots doubled where that explains more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array
from sed2cad.primitives.bspline import Base, BSplineSurface
from sed2cad.primitives.tensor_patch import DEGREE, tensor_basis
from sed2cad.primitives.vectors import root_mean_square, tangent_frame, unit

_MARGIN = 0.06  # of the patch's extent, left around it so that edges with its neighbours lie inside
_SMOOTHING = 1e-5  # weight of the second differences against the mean weight of a control height
_MOST_CONTROLS = 28  # per direction
_LEAST_GAIN = 0.93  # a refinement must bring the rms at least this far down
_FINEST = 2e-5  # rms that nobody needs to go below, unit frame
_NEIGHBOURS = 8  # of a point, that tell whether it belongs
_UNUSUAL = 4.0  # times the median: belongs elsewhere
_FOLD = 0.4  # radians between the normals of neighbours, or rise over run, that happens in a patch
_STEEPEST = 0.25  # cosine: a patch over a plane must not be steeper than this


@dataclass(frozen=True)
class _Chart:
    """Base coordinates of the points to be fitted."""

    base: Base
    origin: Array  # (3,)
    frame: Array  # (3, 3)
    uv: Array  # (n, 2)
    heights: Array  # (n,)
    slant: Array  # (n,), cosine between normal and base direction: vertical to orthogonal distance


def fit_bspline(points: Array, normals: Array, noise: float = 0.0) -> BSplineSurface | None:
    """The coarsest cubic patch through points (n, 3) to within the noise, or None for fewer than 6 points.

    The base is a plane where all normals lie on one side of one, otherwise an axis across the normals. The
    control grid grows from 4 x 4 until the rms is about the noise, the gain fades or the points run out.
    """
    if len(points) < 6:
        return None
    belong = belonging(points, normals)
    points, normals = points[belong], normals[belong]
    charts = [_axis_chart(points, normals)]
    plane = _plane_chart(points, normals)
    if np.quantile(plane.slant, 0.02) > _STEEPEST:
        charts = [plane]
    elif np.quantile(plane.slant, 0.1) > 0:
        charts.append(plane)
    return min((_refined(chart, noise) for chart in charts), key=lambda found: found[1])[0]


def fit_over_plane(points: Array, normals: Array, noise: float = 0.0) -> BSplineSurface | None:
    """The coarsest cubic patch over a plane; None for fewer than 6 points, or where it would fold over."""
    if len(points) < 6:
        return None
    chart = _plane_chart(points, normals)
    return _refined(chart, noise)[0] if np.quantile(chart.slant, 0.02) > 0 else None


def belonging(points: Array, normals: Array) -> NDArray[np.bool_]:
    """Points (n,) that lie on the tangent planes of their neighbours and have about their normals.

    What is allowed is several times what is usual in the patch, and as much as a fold needs in any case. Everything
    belongs where less than half would.
    """
    distance, near = cKDTree(points).query(points, k=min(_NEIGHBOURS + 1, len(points)))
    distance, near = distance[:, 1:], near[:, 1:]
    cosine = np.einsum("ij,ikj->ik", normals, normals[near])
    height = np.abs(np.einsum("ikj,ikj->ik", points[:, None] - points[near], normals[near]))
    turn = np.median(np.arccos(np.clip(cosine, -1, 1)), axis=1)
    slope = np.median(height, axis=1) / np.maximum(np.median(distance, axis=1), 1e-300)
    belong = np.ones(len(points), bool)
    for unlike in (turn, slope):
        belong &= unlike <= max(_UNUSUAL * float(np.median(unlike)), _FOLD)
    return belong if 2 * belong.sum() >= max(len(points), 12) else np.ones(len(points), bool)


def _plane_chart(points: Array, normals: Array) -> _Chart:
    """Over the plane that the steepest of the normals (n, 3) is least steep to."""
    z = unit(normals.mean(axis=0))
    for sharpness in (2.0, 4.0, 8.0):  # soft maximum of the smallest normal . z
        z = unit(np.exp(-sharpness * (normals @ z)) @ normals)
    x, y = tangent_frame(z)
    origin = points.mean(axis=0)
    flat = (points - origin) @ np.column_stack([x, y])
    long = np.linalg.eigh(flat.T @ flat)[1][:, 1]
    x = long[0] * x + long[1] * y
    frame = np.stack([x, np.cross(z, x), z])
    local = (points - origin) @ frame.T
    return _Chart("plane", origin, frame, local[:, :2], local[:, 2], normals @ z)


def _axis_chart(points: Array, normals: Array) -> _Chart:
    """About the direction most nearly across all normals, through the point nearest to all normal lines."""
    z = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    x, y = tangent_frame(z)
    across = np.column_stack([x, y])
    flat, arrows = points @ across, unit(normals @ across)
    reject = np.eye(2) - arrows[:, :, None] * arrows[:, None, :]
    centre = np.linalg.lstsq(reject.sum(0), np.einsum("nij,nj->i", reject, flat), rcond=1e-9)[0]
    origin = across @ centre + z * float((points @ z).mean())
    a, b, c = ((points - origin) @ np.stack([x, y, z]).T).T
    radial = np.column_stack([np.cos(np.arctan2(b, a)), np.sin(np.arctan2(b, a))])
    slant = np.einsum("ij,ij->i", radial, normals @ across)
    uv = np.column_stack([np.arctan2(b, a), c])
    return _Chart("cylinder", origin, np.stack([x, y, z]), uv, np.hypot(a, b), slant)


def _refined(chart: _Chart, noise: float) -> tuple[BSplineSurface, float]:
    """Spans doubled in the direction that gains more, until the noise is reached. The patch and its rms.

    One step that gains little is forgiven (a fold may need several knots), a second one not. At the noise only what
    gains more than its control heights cost goes on (Mallows 1973): a bend of a third of the noise is in reach of many
    points.
    """
    spans, points = (1, 1) if chart.base == "plane" else (6, 1), len(chart.uv)
    best = current = (*_solved(chart, spans), spans)
    patience = 1
    while current[1] > _FINEST and patience >= 0:
        reached = current[1] <= 1.1 * noise
        u, v = current[2]
        grids = ((2 * u, v), (u, 2 * v), (2 * u, 2 * v))
        trials = [(*_solved(chart, grid), grid) for grid in grids if _affordable(*grid, points)]
        if not trials:
            break
        finest = min(rms for _, rms, _ in trials)
        price = 2 * max(noise, finest) ** 2 / points if reached else 0.0
        current = min(trials, key=lambda found: found[1] ** 2 + price * found[0].heights.size)
        fall, heights = best[1] ** 2 - current[1] ** 2, current[0].heights.size - best[0].heights.size
        if fall > price * heights if reached else current[1] < _LEAST_GAIN * best[1]:
            best, patience = current, 1
        else:
            patience = -1 if reached else patience - 1
    return best[0], best[1]


def _affordable(spans_u: int, spans_v: int, points: int) -> bool:
    controls = (spans_u + DEGREE, spans_v + DEGREE)
    return max(controls) <= _MOST_CONTROLS and controls[0] * controls[1] <= max(points // 2, 16)


def _solved(chart: _Chart, spans: tuple[int, int]) -> tuple[BSplineSurface, float]:
    """Least squares on a grid of spans: the patch and the rms of the orthogonal distances."""
    low, high = chart.uv.min(axis=0), chart.uv.max(axis=0)
    margin = np.maximum(_MARGIN * (high - low), 1e-9 + 1e-3 * (high - low).max())
    low, high = low - margin, high + margin
    knots_u = _clamped(low[0], high[0], spans[0]) if chart.base == "plane" else _periodic(spans[0])
    knots_v = _clamped(low[1], high[1], spans[1])
    count_u = len(knots_u) - DEGREE - 1 if chart.base == "plane" else spans[0]
    count_v = len(knots_v) - DEGREE - 1
    design = tensor_basis(chart.uv, knots_u, knots_v, count_u, count_v)
    weight = np.abs(chart.slant).clip(0.05)
    weighted = design.multiply(weight[:, None]).tocsr()
    normal_matrix = (weighted.T @ weighted).toarray()
    mean = np.trace(normal_matrix) / len(normal_matrix)
    roughness = _roughness(chart.base, count_u, count_v)
    normal_matrix += mean * (_SMOOTHING * roughness + 1e-11 * np.eye(len(roughness)))
    solution = cho_solve(cho_factor(normal_matrix), weighted.T @ (weight * chart.heights))
    residual = weight * (design @ solution - chart.heights)
    heights = solution.reshape(count_u, count_v)
    if chart.base == "cylinder":
        heights = np.vstack([heights, heights[:DEGREE]])
    surface = BSplineSurface(chart.base, chart.origin, chart.frame, knots_u, knots_v, heights)
    return surface, root_mean_square(residual)


def _clamped(low: float, high: float, spans: int) -> Array:
    """Cubic knots with full ends."""
    return np.clip(low + (high - low) / spans * _steps(spans), low, high)


def _periodic(spans: int) -> Array:
    """Uniform cubic knots that go on beyond -pi and pi."""
    return -np.pi + 2 * np.pi / spans * _steps(spans)


def _steps(spans: int) -> Array:
    """Knots with unit distances, three more on either side of 0 .. spans."""
    return np.arange(-DEGREE, spans + DEGREE + 1).astype(np.float64)


def _roughness(base: Base, count_u: int, count_v: int) -> Array:
    """Sum of squared second differences of the control heights, as a matrix (count, count)."""

    def gram(count: int, periodic: bool) -> Array:
        eye = np.eye(count)
        second = np.roll(eye, 1, axis=0) - 2 * eye + np.roll(eye, -1, axis=0)
        second = second if periodic else second[1:-1]
        return np.asarray(second.T @ second)

    along_u = np.kron(gram(count_u, base == "cylinder"), np.eye(count_v))
    return np.asarray(along_u + np.kron(np.eye(count_u), gram(count_v, False)))
