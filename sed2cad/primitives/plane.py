"""The plane n . p = offset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.vectors import across_components, read_direction, read_number, tilted, triple


@dataclass(frozen=True, eq=False)
class Plane(Primitive):
    """Chart: two tilts of the normal (radians, about the origin), the change of the offset."""

    kind: ClassVar[str] = "plane"
    freedom: ClassVar[int] = 3

    normal_vector: Array  # (3,), unit
    offset: float  # signed distance of the plane from the origin along the normal

    def distance(self, points: Array) -> Array:
        return points @ self.normal_vector - self.offset

    def normal(self, points: Array) -> Array:
        return np.broadcast_to(self.normal_vector, points.shape).copy()

    def moved(self, delta: Array) -> Self:
        return type(self)(tilted(self.normal_vector, delta[:2]), self.offset + float(delta[2]))

    def jacobian(self, points: Array) -> Array:
        return np.column_stack([across_components(points, self.normal_vector), np.full(len(points), -1.0)])

    def scaled(self, scale: float, origin: Array) -> Self:
        return type(self)(self.normal_vector, scale * self.offset + float(self.normal_vector @ origin))

    def parameters(self) -> dict[str, Any]:
        return {"normal": triple(self.normal_vector), "offset": float(self.offset)}

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        return cls(read_direction(parameters, "normal"), read_number(parameters, "offset"))
