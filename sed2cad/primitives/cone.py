"""One nappe of the infinite circular cone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.vectors import (
    about_axis,
    across_components,
    read_direction,
    read_number,
    read_vector,
    tangent_frame,
    tilted,
    triple,
    unit,
)


@dataclass(frozen=True, eq=False)
class Cone(Primitive):
    """Chart about a pivot on the axis: two tilts (radians), two shifts across, radius there, half angle.

    A pivot amid the points keeps these nearly independent, however far away the apex of a slender cone is. A
    half angle moved below zero opens the cone the other way.
    """

    kind: ClassVar[str] = "cone"
    freedom: ClassVar[int] = 6

    axis: Array  # (3,), unit, from the apex into the nappe
    apex: Array  # (3,)
    half_angle: float  # radians, between axis and surface, 0 < half_angle < pi / 2
    reach: float = 0.0  # from the apex along the axis to the pivot; no part of the shape

    def _meridian(self, points: Array) -> tuple[Array, Array, Array]:
        """Distance (n,) to the generatrix, position (n,) along it from the apex, radial direction (n, 3)."""
        height, radius, radial = about_axis(points, self.apex, self.axis)
        cos, sin = np.cos(self.half_angle), np.sin(self.half_angle)
        return radius * cos - height * sin, radius * sin + height * cos, radial

    def distance(self, points: Array) -> Array:
        across, along, _ = self._meridian(points)
        return np.where(along > 0, across, np.hypot(across, along))

    def normal(self, points: Array) -> Array:
        return self.distance_and_normal(points)[1]

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        across, along, radial = self._meridian(points)
        normals = radial * np.cos(self.half_angle) - self.axis * np.sin(self.half_angle)
        behind = along <= 0  # nearest to the apex itself
        if behind.any():
            away = points[behind] - self.apex
            normals[behind] = np.where(np.any(away != 0, axis=1)[:, None], unit(away), -self.axis)
        return np.where(behind, np.hypot(across, along), across), normals

    def moved(self, delta: Array) -> Self:
        x, y = tangent_frame(self.axis)
        half_angle = self.half_angle + float(delta[5])
        axis = tilted(self.axis, delta[:2]) * np.copysign(1.0, half_angle)
        half_angle = abs(half_angle)
        pivot = self.apex + self.reach * self.axis + delta[2] * x + delta[3] * y
        radius = self.reach * np.tan(self.half_angle) + float(delta[4])
        reach = float(radius / np.tan(half_angle))
        return type(self)(axis, pivot - reach * axis, half_angle, reach)

    def jacobian(self, points: Array) -> Array:
        _, along, radial = self._meridian(points)
        along = np.maximum(along, 0.0)  # behind the apex only its own shift matters
        about_apex = np.zeros((len(points), self.freedom))
        about_apex[:, :2] = along[:, None] * across_components(radial, self.axis)
        about_apex[:, 5] = along
        return -about_apex - self.normal(points) @ self.apex_jacobian()

    def apex_jacobian(self) -> Array:
        """d apex / d delta: (3, 6)."""
        x, y = tangent_frame(self.axis)
        sin, cos = np.sin(self.half_angle), np.cos(self.half_angle)
        slide, swing = -cos / sin * self.axis, self.reach / (sin * cos) * self.axis
        return np.column_stack([-self.reach * x, -self.reach * y, x, y, slide, swing])

    def scaled(self, scale: float, origin: Array) -> Self:
        return type(self)(self.axis, scale * self.apex + origin, self.half_angle, scale * self.reach)

    def parameters(self) -> dict[str, Any]:
        return {"axis": triple(self.axis), "apex": triple(self.apex), "half_angle": float(self.half_angle)}

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        axis, apex = read_direction(parameters, "axis"), read_vector(parameters, "apex")
        half_angle = read_number(parameters, "half_angle")
        if not 0 < half_angle < np.pi / 2:
            raise ValueError(f"The half angle must lie between 0 and pi / 2 radians, not {half_angle:g}.")
        return cls(axis, apex, half_angle)
