"""The torus: a circle of the minor radius turned about an axis at the major radius."""

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
    tilted,
    triple,
)


@dataclass(frozen=True, eq=False)
class Torus(Primitive):
    """Chart: two tilts of the axis about the centre (radians), the centre (3), major and minor radius.

    With a minor radius above the major one (a fillet on a thin pin) the surface crosses its axis; distances
    are then those of its outer, apple-shaped part.
    """

    kind: ClassVar[str] = "torus"
    freedom: ClassVar[int] = 7

    axis: Array  # (3,), unit
    centre: Array  # (3,)
    major_radius: float
    minor_radius: float

    def _tube(self, points: Array) -> tuple[Array, Array, Array, Array]:
        """Height, distance from the tube's centre circle, cosine of the way from there outwards, radial."""
        height, radius, radial = about_axis(points, self.centre, self.axis)
        outwards = radius - self.major_radius
        from_tube = np.hypot(outwards, height)
        outwards = np.where(from_tube > 1e-15, outwards / np.maximum(from_tube, 1e-15), 1.0)
        return height, from_tube, outwards, radial

    def distance(self, points: Array) -> Array:
        return self._tube(points)[1] - self.minor_radius

    def normal(self, points: Array) -> Array:
        return self.distance_and_normal(points)[1]

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        height, from_tube, outwards, radial = self._tube(points)
        upwards = height / np.maximum(from_tube, 1e-15)
        return from_tube - self.minor_radius, outwards[:, None] * radial + upwards[:, None] * self.axis

    def moved(self, delta: Array) -> Self:
        axis = tilted(self.axis, delta[:2])
        major, minor = self.major_radius + float(delta[5]), self.minor_radius + float(delta[6])
        return type(self)(axis, self.centre + delta[2:5], major, minor)

    def jacobian(self, points: Array) -> Array:
        height, from_tube, outwards, radial = self._tube(points)
        upwards = height / np.maximum(from_tube, 1e-15)
        tilts = (self.major_radius * upwards)[:, None] * across_components(radial, self.axis)
        normals = outwards[:, None] * radial + upwards[:, None] * self.axis
        return np.column_stack([tilts, -normals, -outwards, np.full(len(points), -1.0)])

    def scaled(self, scale: float, origin: Array) -> Self:
        centre = scale * self.centre + origin
        return type(self)(self.axis, centre, scale * self.major_radius, scale * self.minor_radius)

    def parameters(self) -> dict[str, Any]:
        return {
            "axis": triple(self.axis),
            "centre": triple(self.centre),
            "major_radius": float(self.major_radius),
            "minor_radius": float(self.minor_radius),
        }

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        axis, centre = read_direction(parameters, "axis"), read_vector(parameters, "centre")
        major, minor = read_length(parameters, "major_radius"), read_length(parameters, "minor_radius")
        return cls(axis, centre, major, minor)
