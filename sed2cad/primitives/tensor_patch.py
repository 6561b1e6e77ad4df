"""What cubic tensor-product patches have in common: bounded parameters, and the nearest point."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.vectors import unit

DEGREE = 3
_STILL = 1e-10  # a step that is shorter changes nothing
_FOOT_STEPS = 5


class TensorPatch(Primitive):
    """A patch S(u, v) over a rectangle of parameters, which its knots bound.

    Beyond it the distance is that to its border (with the sign of the side) and the normal that of the border.
    """

    kind: ClassVar[str] = "bspline"
    freedom: ClassVar[int] = 0
    freeform: ClassVar[bool] = True

    knots_u: Array  # (nu + 4,)
    knots_v: Array  # (nv + 4,), clamped

    @property
    @abstractmethod
    def shape_numbers(self) -> int:
        """How many numbers shape the surface; control points that slide along it do not."""

    @abstractmethod
    def tangents(self, uv: Array) -> tuple[Array, Array, Array]:
        """Points (n, 3) and their derivatives by u and v at parameters (n, 2)."""

    @abstractmethod
    def _clipped(self, uv: Array) -> Array:
        """Parameters (n, 2) brought into the domain."""

    @abstractmethod
    def _first_guess(self, points: Array) -> Array:
        """Parameters (n, 2) near those of the feet of points (n, 3)."""

    @cached_property
    def domain(self) -> tuple[Array, Array]:
        """Lowest and highest (u, v), each (2,)."""
        u, v = self.knots_u, self.knots_v
        low, high = DEGREE, -DEGREE - 1
        return np.array([u[low], v[low]]), np.array([u[high], v[high]])

    def at(self, uv: Array) -> Array:
        """Points (n, 3) of the surface at parameters (n, 2)."""
        return self.tangents(uv)[0]

    def foot(self, points: Array, start: Array | None = None) -> Array:
        """Parameters (n, 2) of the nearest points of the patch: Gauss-Newton from `start` (n, 2), or a guess."""
        uv = self._clipped(self._first_guess(points) if start is None else start)
        least, candidate, moving = np.full(len(points), np.inf), uv.copy(), np.arange(len(points))
        for _ in range(_FOOT_STEPS):
            surface, du, dv = self.tangents(candidate)
            gap = points[moving] - surface
            square = np.einsum("ij,ij->i", gap, gap)
            better = square < least[moving]
            moving = moving[better]
            uv[moving], least[moving] = candidate[better], square[better]
            step = newton_step(gap[better], du[better], dv[better])
            far = np.abs(step).max(axis=1, initial=0.0) > _STILL
            moving, candidate = moving[far], self._clipped(uv[moving[far]] + step[far])
            if not len(moving):
                break
        return uv

    def _gap(self, points: Array) -> tuple[Array, Array, Array]:
        """Foot points (n, 3), normals there (n, 3) and signed distances (n,)."""
        surface, du, dv = self.tangents(self.foot(points))
        normals, gap = unit(np.cross(du, dv)), points - surface
        side = np.einsum("ij,ij->i", gap, normals)
        return surface, normals, np.copysign(np.linalg.norm(gap, axis=1), side)

    def distance(self, points: Array) -> Array:
        return self._gap(points)[2]

    def normal(self, points: Array) -> Array:
        return self._gap(points)[1]

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        _, normals, distance = self._gap(points)
        return distance, normals

    def project(self, points: Array) -> Array:
        return self._gap(points)[0]

    def moved(self, delta: Array) -> Self:
        return self

    def jacobian(self, points: Array) -> Array:
        return np.zeros((len(points), 0))


def greville(knots: Array) -> Array:
    """Greville abscissae (n,) of cubic knots (n + 4,)."""
    return (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3


def newton_step(gap: Array, du: Array, dv: Array) -> Array:
    """The (u, v) step (n, 2) that moves along du, dv (n, 3) towards the gap (n, 3)."""
    uu, uv, vv = (np.einsum("ij,ij->i", a, b) for a, b in ((du, du), (du, dv), (dv, dv)))
    gu, gv = np.einsum("ij,ij->i", gap, du), np.einsum("ij,ij->i", gap, dv)
    det = np.maximum(uu * vv - uv * uv, 1e-300)
    return np.column_stack([vv * gu - uv * gv, uu * gv - uv * gu]) / det[:, None]


def tensor_basis(uv: Array, knots_u: Array, knots_v: Array, count_u: int, count_v: int) -> csr_array:
    """Tensor basis (n, count_u * count_v), sixteen numbers a row; columns beyond count_u wrap around."""
    rows = len(uv)
    values, columns = [], []
    for parameters, knots in ((uv[:, 0], knots_u), (uv[:, 1], knots_v)):
        inside = np.clip(parameters, knots[DEGREE], knots[-DEGREE - 1])
        basis = BSpline.design_matrix(inside, knots, DEGREE)
        values.append(basis.data.reshape(rows, DEGREE + 1))
        columns.append(basis.indices.reshape(rows, DEGREE + 1))
    value = values[0][:, :, None] * values[1][:, None, :]
    column = (columns[0] % count_u)[:, :, None] * count_v + columns[1][:, None, :]
    start = np.arange(rows + 1) * (DEGREE + 1) ** 2
    return csr_array((value.ravel(), column.ravel(), start), shape=(rows, count_u * count_v))
