"""The freeform patch that explains points best: over a base where that does, else a control net."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from sed2cad.primitives.base import Array
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.bspline_fit import belonging, fit_bspline
from sed2cad.primitives.net_fit import NetFit, fit_net, stiffened
from sed2cad.primitives.tensor_patch import TensorPatch
from sed2cad.primitives.unroll import Unrolled, unrolled
from sed2cad.primitives.vectors import root_mean_square

Starts = Callable[[Array, Array], Iterable[Unrolled]]
"""Base parameters for points (n, 3) with unit normals (n, 3)."""

_ENOUGH = 2e-5  # rms of a patch over a base that no net need improve, unit frame
_REACHED = 1.1  # noises
_POOR = 5.0  # times what is enough: a net from which other starts are asked for
_BETTER = 0.7  # of the rms over a base: that of a net worth having
_FOLDED = 0.005  # share of places where the net may turn its back on the points near by: their border
_STIFFER = (1e-5, 1e-3, 1e-2, 1e-1)  # smoothing that may take folds out
_NEAR_BASE = 0.02  # of the size: rms over a base that is a start
_MOST = 0.7  # of the points: those that may not lie elsewhere
_OF_MOST = 1.25 * 1.036  # noises that most distances are below; 1.036 of a normal distribution


def fit_freeform(
    points: Array, normals: Array, noise: float = 0.0, predicted: Starts | None = None
) -> TensorPatch | None:
    """The cubic patch through points (n, 3) with unit normals (n, 3); None for fewer than 6.

    A patch over a plane or about an axis, where that reaches the noise; else the control net that comes nearest,
    where it is much nearer and has no folds. Nets are fitted from base parameters: those of the base, of the sheet
    unrolled and, where these are far from the noise, `predicted` ones (SplineNet's).
    """
    over_base = fit_bspline(points, normals, noise)
    if over_base is None:
        return None
    if noise > 0:
        belong = belonging(points, normals)
        points, normals = points[belong], normals[belong]
    if _explains(over_base, points, noise):
        return over_base
    enough = max(_REACHED * noise, _ENOUGH)
    least = _BETTER * root_mean_square(over_base.distance(points))
    found = _best_net(_starts(points, normals, over_base), points, normals, noise, least, enough)
    if predicted and (least if found is None else found.rms) > _POOR * enough:
        limit = least if found is None else found.rms
        found = _best_net(predicted(points, normals), points, normals, noise, limit, enough) or found
    return over_base if found is None else found.surface


def _best_net(
    starts: Iterable[Unrolled], points: Array, normals: Array, noise: float, limit: float, enough: float
) -> NetFit | None:
    """The net of the least rms below `limit` without folds; what is `enough` ends the search."""
    best = None
    for start in starts:
        found = fit_net(points, start, noise)
        found = None if found is None or found.rms >= limit else _unfolded(found, points, normals)
        if found is not None and found.rms < limit:
            best, limit = found, found.rms
        if limit <= enough:
            break
    return best


def _unfolded(fit: NetFit, points: Array, normals: Array) -> NetFit | None:
    """The net, or a stiffer one without folds; None where even that has some."""
    if not folded(fit, points, normals):
        return fit
    for smoothing in _STIFFER:
        if smoothing > fit.grid.smoothing and not folded(stiff := stiffened(points, fit, smoothing), points, normals):
            return stiff
    return None


def folded(fit: NetFit, points: Array, normals: Array) -> bool:
    """Whether the net's normals turn over: at the points (n, 3) or, near them, in between."""
    low, high = fit.surface.domain
    _, du, dv = fit.surface.tangents(fit.uv)
    side = np.einsum("ij,ij->i", np.cross(du, dv), normals)
    if np.minimum((side > 0).mean(), (side < 0).mean()) > _FOLDED:
        return True
    scale = (high - low) / np.sqrt(len(points))
    rng = np.random.default_rng(0)
    between = np.clip(fit.uv + scale * rng.uniform(-1, 1, fit.uv.shape), low, high)
    _, du, dv = fit.surface.tangents(between)
    same = np.einsum("ij,ij->i", np.cross(du, dv), normals) * np.sign(np.median(side)) > 0
    return bool((~same).mean() > 2 * _FOLDED)


def _starts(points: Array, normals: Array, over_base: BSplineSurface) -> Iterator[Unrolled]:
    """Base parameters worth trying, likely ones first."""
    yield from unrolled(points, normals)
    if root_mean_square(over_base.distance(points)) < _NEAR_BASE * float(np.ptp(points, axis=0).max()):
        yield _of_base(over_base, points)


def _of_base(surface: BSplineSurface, points: Array) -> Unrolled:
    """The feet of points (n, 3) on a patch over a base, as lengths."""
    uv = surface.foot(points)
    if surface.base == "plane":
        return Unrolled(uv, 0.0, 0.0)
    radius = float(np.median(surface.base_coordinates(points)[1]))
    angle = np.sort(uv[:, 0])
    gap = np.append(np.diff(angle), angle[0] + 2 * np.pi - angle[-1])
    if gap.max() < 0.2:
        return Unrolled(np.column_stack([np.mod(uv[:, 0], 2 * np.pi) * radius, uv[:, 1]]), 2 * np.pi * radius, 0.0)
    first = angle[(int(gap.argmax()) + 1) % len(angle)]
    return Unrolled(np.column_stack([np.mod(uv[:, 0] - first, 2 * np.pi) * radius, uv[:, 1]]), 0.0, 0.0)


def _explains(surface: BSplineSurface, points: Array, noise: float) -> bool:
    """Whether nothing is left to explain, or but for some points that may lie elsewhere."""
    distance = np.abs(surface.distance(points))
    if root_mean_square(distance) <= max(_REACHED * noise, _ENOUGH):
        return True
    return float(np.quantile(distance, _MOST)) <= _OF_MOST * noise
