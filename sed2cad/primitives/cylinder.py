"""The infinite circular cylinder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.vectors import (
    about_axis,
    across_components,
    read_direction,
    read_length,
    read_vector,
    tangent_frame,
    tilted,
    triple,
)


@dataclass(frozen=True, eq=False)
class Cylinder(Primitive):
    """Chart: two tilts of the axis about `point` (radians), two shifts of `point` across it, the radius."""

    kind: ClassVar[str] = "cylinder"
    freedom: ClassVar[int] = 5

    axis: Array  # (3,), unit
    point: Array  # (3,), any point of the axis; fits put it amid their points
    radius: float

    def distance(self, points: Array) -> Array:
        return about_axis(points, self.point, self.axis)[1] - self.radius

    def normal(self, points: Array) -> Array:
        return about_axis(points, self.point, self.axis)[2]

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        _, radius, radial = about_axis(points, self.point, self.axis)
        return radius - self.radius, radial

    def moved(self, delta: Array) -> Self:
        x, y = tangent_frame(self.axis)
        point = self.point + delta[2] * x + delta[3] * y
        return type(self)(tilted(self.axis, delta[:2]), point, self.radius + float(delta[4]))

    def jacobian(self, points: Array) -> Array:
        height, _, radial = about_axis(points, self.point, self.axis)
        across = across_components(radial, self.axis)
        return np.column_stack([-height[:, None] * across, -across, np.full(len(points), -1.0)])

    def scaled(self, scale: float, origin: Array) -> Self:
        return type(self)(self.axis, scale * self.point + origin, scale * self.radius)

    def parameters(self) -> dict[str, Any]:
        return {"axis": triple(self.axis), "point": triple(self.point), "radius": float(self.radius)}

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        axis, point = read_direction(parameters, "axis"), read_vector(parameters, "point")
        return cls(axis, point, read_length(parameters, "radius"))
