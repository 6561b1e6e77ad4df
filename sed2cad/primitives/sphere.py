"""The sphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.vectors import read_length, read_vector, triple, unit


@dataclass(frozen=True, eq=False)
class Sphere(Primitive):
    """Chart: the centre (3), the radius."""

    kind: ClassVar[str] = "sphere"
    freedom: ClassVar[int] = 4

    centre: Array  # (3,)
    radius: float

    def distance(self, points: Array) -> Array:
        return np.linalg.norm(points - self.centre, axis=1) - self.radius

    def normal(self, points: Array) -> Array:
        normals = unit(points - self.centre)
        normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)  # the centre itself
        return normals

    def moved(self, delta: Array) -> Self:
        return type(self)(self.centre + delta[:3], self.radius + float(delta[3]))

    def jacobian(self, points: Array) -> Array:
        return np.column_stack([-self.normal(points), np.full(len(points), -1.0)])

    def scaled(self, scale: float, origin: Array) -> Self:
        return type(self)(scale * self.centre + origin, scale * self.radius)

    def parameters(self) -> dict[str, Any]:
        return {"centre": triple(self.centre), "radius": float(self.radius)}

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        return cls(read_vector(parameters, "centre"), read_length(parameters, "radius"))
