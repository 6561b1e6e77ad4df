"""The freeform patch that no base carries: a cubic tensor B-spline of control points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from scipy.interpolate import NdBSpline
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array
from sed2cad.primitives.tensor_patch import DEGREE, TensorPatch, newton_step
from sed2cad.primitives.vectors import read_table

_PER_SPAN = 4  # samples from which the nearest point is looked for
_FOOT_STEPS = 12
_RESTING = 1e-9  # of the extent of the parameters: a step that leads nowhere
_LEAST = 12  # samples in each direction


@dataclass(frozen=True, eq=False)
class NetSurface(TensorPatch):
    """S(u, v) = sum of control points times cubic basis functions; u and v are about lengths.

    Where it is closed, u is periodic and the last three rows of the net repeat the first three.
    """

    base: ClassVar[str] = "net"
    closed: bool  # in u
    knots_u: Array  # (nu + 4,), clamped, or going on periodically beyond both ends
    knots_v: Array  # (nv + 4,), clamped
    net: Array  # (nu, nv, 3)

    @property
    def period(self) -> float:
        """Of u; 0 where it is open."""
        low, high = self.domain
        return float(high[0] - low[0]) if self.closed else 0.0

    @property
    def shape_numbers(self) -> int:
        return self.net.size // 3

    @cached_property
    def _spline(self) -> NdBSpline:
        return NdBSpline((self.knots_u, self.knots_v), self.net, DEGREE)

    def tangents(self, uv: Array) -> tuple[Array, Array, Array]:
        s, su, sv = (self._spline(uv, nu=order) for order in ((0, 0), (1, 0), (0, 1)))
        return s, su, sv

    def _clipped(self, uv: Array) -> Array:
        low, high = self.domain
        if self.closed:
            uv = np.column_stack([low[0] + np.mod(uv[:, 0] - low[0], self.period), uv[:, 1]])
        return np.clip(uv, low, high)

    @cached_property
    def _samples(self) -> tuple[cKDTree, Array]:
        """Points all over the patch to search, and their parameters (m, 2)."""
        u, v = (_spread(knots) for knots in (self.knots_u, self.knots_v))
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        return cKDTree(self._spline(uv)), uv

    def _first_guess(self, points: Array) -> Array:
        tree, uv = self._samples
        return np.asarray(uv[tree.query(points)[1]])

    def foot(self, points: Array, start: Array | None = None, steps: int = _FOOT_STEPS) -> Array:
        """Parameters (n, 2) of the nearest points: damped Gauss-Newton that slides along the borders."""
        uv = self._clipped(self._first_guess(points) if start is None else start)
        surface, du, dv = self.tangents(uv)
        gap = points - surface
        square, share = np.einsum("ij,ij->i", gap, gap), np.ones(len(points))
        active = np.arange(len(points))
        for _ in range(steps):
            step = share[active, None] * self._step(uv[active], gap[active], du[active], dv[active])
            moving = np.abs(step).max(axis=1, initial=0.0) > _RESTING * self._length
            active, step = active[moving], step[moving]
            if not len(active):
                break
            candidate = self._clipped(uv[active] + step)
            found, found_u, found_v = self.tangents(candidate)
            rest = points[active] - found
            new = np.einsum("ij,ij->i", rest, rest)
            better = new < square[active]
            took = active[better]
            uv[took], gap[took], square[took] = candidate[better], rest[better], new[better]
            du[took], dv[took] = found_u[better], found_v[better]
            share[active] = np.where(better, np.minimum(2 * share[active], 1.0), 0.3 * share[active])
        return uv

    @cached_property
    def _length(self) -> float:
        """The larger extent of the parameters."""
        low, high = self.domain
        return float((high - low).max())

    def _step(self, uv: Array, gap: Array, du: Array, dv: Array) -> Array:
        """Steps (n, 2) towards the feet; along a border (open directions) where the full one leads out of it."""
        step = newton_step(gap, du, dv)
        low, high = self.domain
        out = ((uv <= low) & (step < 0)) | ((uv >= high) & (step > 0))
        out[:, 0] &= not self.closed
        for k, tangent in enumerate((du, dv)):
            alone = np.einsum("ij,ij->i", gap, tangent) / np.maximum(np.einsum("ij,ij->i", tangent, tangent), 1e-300)
            step[:, k] = np.where(out[:, 1 - k], alone, step[:, k])
            step[:, 1 - k] = np.where(out[:, 1 - k], 0.0, step[:, 1 - k])
        return step

    def scaled(self, scale: float, origin: Array) -> Self:
        return type(self)(self.closed, scale * self.knots_u, scale * self.knots_v, scale * self.net + origin)

    def parameters(self) -> dict[str, Any]:
        return {
            "base": self.base,
            "closed": self.closed,
            "knots_u": tuple(map(float, self.knots_u)),
            "knots_v": tuple(map(float, self.knots_v)),
            "net": tuple(tuple(tuple(map(float, point)) for point in row) for row in self.net),
        }

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        u, v, net = (read_table(parameters, name) for name in ("knots_u", "knots_v", "net"))
        closed = parameters.get("closed")
        if not isinstance(closed, bool):
            raise ValueError("Whether a control net is closed must be true or false.")
        if net.ndim != 3 or net.shape[2] != 3 or min(net.shape[:2]) < DEGREE + 1:
            raise ValueError("A control net must be a table of at least 4 by 4 points.")
        if u.shape != (net.shape[0] + 4,) or v.shape != (net.shape[1] + 4,):
            raise ValueError("The knots and the control net of a B-spline do not fit together.")
        if any((np.diff(knots) < 0).any() or knots[-4] <= knots[3] for knots in (u, v)):
            raise ValueError("The knots of a B-spline must ascend.")
        return cls(closed, u, v, net)


def _spread(knots: Array) -> Array:
    """Parameters (m,) between the ends of cubic knots, so many in each span."""
    edges = np.unique(knots[DEGREE : len(knots) - DEGREE])
    count = max(_PER_SPAN, -(-_LEAST // max(len(edges) - 1, 1)))
    steps = np.arange(count) / count
    return np.append((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel(), edges[-1])
