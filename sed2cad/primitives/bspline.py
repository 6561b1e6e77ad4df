"""The freeform patch: a cubic tensor B-spline of heights over a plane or of radii about an axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Self, get_args

import numpy as np
from scipy.interpolate import NdBSpline

from sed2cad.primitives.base import Array
from sed2cad.primitives.tensor_patch import DEGREE, TensorPatch, greville
from sed2cad.primitives.vectors import read_direction, read_table, read_vector, triple

Base = Literal["plane", "cylinder"]


@dataclass(frozen=True, eq=False)
class BSplineSurface(TensorPatch):
    """Over a plane S(u, v) = origin + u x + v y + h(u, v) z; about an axis o + h (x cos u + y sin u) + v z.

    The patch is bounded by its knots: beyond them the distance is that to its border (with the sign of the
    side) and the normal that of the border. About an axis u is periodic on [-pi, pi] with uniform knots, and
    the last three rows of `heights` repeat the first three.
    """

    base: Base
    origin: Array  # (3,)
    frame: Array  # (3, 3), rows x, y, z
    knots_u: Array  # (nu + 4,); lengths over a plane, radians about an axis
    knots_v: Array  # (nv + 4,), clamped
    heights: Array  # (nu, nv), control heights or control radii

    @property
    def shape_numbers(self) -> int:
        return self.heights.size

    @cached_property
    def _spline(self) -> NdBSpline:
        return NdBSpline((self.knots_u, self.knots_v), self.heights, DEGREE)

    def tangents(self, uv: Array) -> tuple[Array, Array, Array]:
        """Points (n, 3) and their derivatives by u and v at parameters (n, 2)."""
        x, y, z = self.frame
        h, hu, hv = (self._spline(uv, nu=order)[:, None] for order in ((0, 0), (1, 0), (0, 1)))
        u, v = uv[:, :1], uv[:, 1:]
        if self.base == "plane":
            return self.origin + u * x + v * y + h * z, x + hu * z, y + hv * z
        radial, around = np.cos(u) * x + np.sin(u) * y, np.cos(u) * y - np.sin(u) * x
        return self.origin + h * radial + v * z, hu * radial + h * around, hv * radial + z

    def _clipped(self, uv: Array) -> Array:
        """Parameters (n, 2) brought into the domain."""
        low, high = self.domain
        if self.base == "cylinder":
            uv = np.column_stack([(uv[:, 0] + np.pi) % (2 * np.pi) - np.pi, uv[:, 1]])
        return np.clip(uv, low, high)

    def base_coordinates(self, points: Array) -> tuple[Array, Array]:
        """Parameters (n, 2), not clipped, and height or radius (n,) of points (n, 3)."""
        a, b, c = ((points - self.origin) @ self.frame.T).T
        if self.base == "plane":
            return np.column_stack([a, b]), c
        return np.column_stack([np.arctan2(b, a), c]), np.hypot(a, b)

    def _first_guess(self, points: Array) -> Array:
        return self.base_coordinates(points)[0]

    def control_points(self) -> Array:
        """The exact control net (nu, nv, 3) of a patch over a plane (x and y linear: Greville abscissae).

        ValueError about an axis, where the surface is not a B-spline of this form.
        """
        if self.base != "plane":
            raise ValueError("Only a patch over a plane has an exact control net.")
        u, v = greville(self.knots_u)[:, None, None], greville(self.knots_v)[None, :, None]
        x, y, z = self.frame
        return self.origin + u * x + v * y + self.heights[:, :, None] * z

    def scaled(self, scale: float, origin: Array) -> Self:
        knots_u = self.knots_u * scale if self.base == "plane" else self.knots_u
        return type(self)(
            self.base,
            scale * self.origin + origin,
            self.frame,
            knots_u,
            scale * self.knots_v,
            scale * self.heights,
        )

    def parameters(self) -> dict[str, Any]:
        return {
            "base": self.base,
            "origin": triple(self.origin),
            "x_axis": triple(self.frame[0]),
            "z_axis": triple(self.frame[2]),
            "knots_u": tuple(map(float, self.knots_u)),
            "knots_v": tuple(map(float, self.knots_v)),
            "heights": tuple(tuple(map(float, row)) for row in self.heights),
        }

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        base: Base | None = parameters.get("base")
        if base not in get_args(Base) or base is None:
            raise ValueError(f"The base of a B-spline must be one of {', '.join(get_args(Base))}.")
        x, z = read_direction(parameters, "x_axis"), read_direction(parameters, "z_axis")
        frame = np.stack([x, np.cross(z, x), z])
        if not np.allclose(frame @ frame.T, np.eye(3), atol=1e-6):
            raise ValueError("The x and z axes of a B-spline must be perpendicular.")
        u, v, h = (read_table(parameters, name) for name in ("knots_u", "knots_v", "heights"))
        if h.ndim != 2 or u.shape != (h.shape[0] + 4,) or v.shape != (h.shape[1] + 4,):
            raise ValueError("The knots and heights of a B-spline do not fit together.")
        return cls(base, read_vector(parameters, "origin"), frame, u, v, h)
