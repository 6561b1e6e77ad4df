"""The general cylinder: a planar profile swept along a direction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.profile import Profile
from sed2cad.primitives.vectors import (
    across_components,
    read_direction,
    read_vector,
    tilted,
    triple,
    unit,
)


@dataclass(frozen=True, eq=False)
class Extrusion(Primitive):
    """S(t, v) = origin + a(t) x + b(t) y + v direction, with the profile (a, b) and y = direction cross x.

    Endless along the direction, bounded by the ends of an open profile. Chart: two tilts of the direction about the
    origin (radians); the profile is no part of it.
    """

    kind: ClassVar[str] = "extrusion"
    freedom: ClassVar[int] = 2
    freeform: ClassVar[bool] = True

    direction: Array  # (3,), unit
    origin: Array  # (3,)
    x_axis: Array  # (3,), unit, across the direction
    profile: Profile

    @cached_property
    def axes(self) -> Array:
        """The axes of the profile's plane, rows x, y (2, 3)."""
        return np.stack([self.x_axis, np.cross(self.direction, self.x_axis)])

    def flat(self, points: Array) -> Array:
        """Points (n, 3) seen along the direction, (n, 2)."""
        return np.asarray((points - self.origin) @ self.axes.T)

    def distance(self, points: Array) -> Array:
        return self.profile.gap(self.flat(points))[2]

    def normal(self, points: Array) -> Array:
        return np.asarray(self.profile.gap(self.flat(points))[1] @ self.axes)

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        _, normal, distance = self.profile.gap(self.flat(points))
        return distance, np.asarray(normal @ self.axes)

    def project(self, points: Array) -> Array:
        flat = self.flat(points)
        return np.asarray(points + (self.profile.gap(flat)[0] - flat) @ self.axes)

    def moved(self, delta: Array) -> Self:
        direction = tilted(self.direction, delta)
        return replace(self, direction=direction, x_axis=across(self.x_axis, direction))

    def jacobian(self, points: Array) -> Array:
        height = (points - self.origin) @ self.direction
        return np.asarray(-height[:, None] * across_components(self.normal(points), self.direction))

    def scaled(self, scale: float, origin: Array) -> Self:
        return replace(self, origin=scale * self.origin + origin, profile=self.profile.scaled(scale))

    def parameters(self) -> dict[str, Any]:
        """direction and x_axis without unit, origin, profile and knots in the unit of the points."""
        return {
            "direction": triple(self.direction),
            "origin": triple(self.origin),
            "x_axis": triple(self.x_axis),
            **self.profile.parameters(),
        }

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        direction, x = read_direction(parameters, "direction"), read_direction(parameters, "x_axis")
        if abs(direction @ x) > 0.99:
            raise ValueError("The x axis of an extrusion must be across its direction.")
        origin = read_vector(parameters, "origin")
        return cls(direction, origin, across(x, direction), Profile.from_parameters(parameters))


def across(x: Array, direction: Array) -> Array:
    """x (3,) without what it has of the direction, unit."""
    return unit(x - (x @ direction) * direction)
