"""The surface of revolution: a profile in a half plane turned about its edge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.profile import Profile
from sed2cad.primitives.vectors import (
    about_axis,
    across_components,
    read_direction,
    read_vector,
    tangent_frame,
    tilted,
    triple,
)


@dataclass(frozen=True, eq=False)
class Revolution(Primitive):
    """S(u, t) = origin + r(t) radial(u) + z(t) axis, with the profile (r, z), r >= 0.

    Bounded by the ends of an open profile; one that ends on the axis has a pole there. Chart: two tilts of the axis
    about the origin (radians), two shifts across it; the profile is no part of it.
    """

    kind: ClassVar[str] = "revolution"
    freedom: ClassVar[int] = 4
    freeform: ClassVar[bool] = True

    axis: Array  # (3,), unit
    origin: Array  # (3,), on the axis, where z is 0
    profile: Profile

    def _meridian(self, points: Array) -> tuple[Array, Array]:
        """Points (n, 3) as (radius, height), (n, 2), and their radial directions (n, 3)."""
        height, radius, radial = about_axis(points, self.origin, self.axis)
        return np.column_stack([radius, height]), radial

    def meridian(self, points: Array) -> Array:
        """Points (n, 3) as (radius, height), (n, 2)."""
        return self._meridian(points)[0]

    def distance(self, points: Array) -> Array:
        return self.profile.gap(self.meridian(points))[2]

    def normal(self, points: Array) -> Array:
        return self.distance_and_normal(points)[1]

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        flat, radial = self._meridian(points)
        _, normal, distance = self.profile.gap(flat)
        return distance, normal[:, :1] * radial + normal[:, 1:] * self.axis

    def project(self, points: Array) -> Array:
        flat, radial = self._meridian(points)
        feet = self.profile.gap(flat)[0]
        return np.asarray(self.origin + feet[:, :1] * radial + feet[:, 1:] * self.axis)

    def moved(self, delta: Array) -> Self:
        x, y = tangent_frame(self.axis)
        origin = self.origin + delta[2] * x + delta[3] * y
        return replace(self, axis=tilted(self.axis, delta[:2]), origin=origin)

    def jacobian(self, points: Array) -> Array:
        flat, radial = self._meridian(points)
        normal = self.profile.gap(flat)[1]
        ways = across_components(radial, self.axis)
        lever = normal[:, 1] * flat[:, 0] - normal[:, 0] * flat[:, 1]
        return np.column_stack([lever[:, None] * ways, -normal[:, :1] * ways])

    def scaled(self, scale: float, origin: Array) -> Self:
        return replace(self, origin=scale * self.origin + origin, profile=self.profile.scaled(scale))

    def parameters(self) -> dict[str, Any]:
        """axis without unit, origin, profile (radius, height) and knots in the unit of the points."""
        return {"axis": triple(self.axis), "origin": triple(self.origin), **self.profile.parameters()}

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        profile = Profile.from_parameters(parameters)
        if profile.at(np.linspace(*profile.ends, 200))[:, 0].min() < -1e-9 * np.abs(profile.controls).max():
            raise ValueError("The radii in the profile of a revolution must not be negative.")
        return cls(read_direction(parameters, "axis"), read_vector(parameters, "origin"), profile)

    def poles(self) -> tuple[bool, bool]:
        """Whether the first and the last end of the profile lie on the axis."""
        if self.profile.closed:
            return False, False
        ends = self.profile.controls[[0, -1], 0]
        first, last = ends < 1e-9 * np.abs(self.profile.controls).max()
        return bool(first), bool(last)


def reaching(profile: Profile, reach: float, round: bool = False, snap: float = 0.0) -> Profile:
    """An open profile (r, z) that goes on by `reach` beyond its ends, but not across the axis.

    An end from which the axis is within `snap` or the reach goes straight on to it.
    """
    for _ in range(2):
        end = np.array([profile.ends[1]])
        radius, inwards = float(profile.at(end)[0, 0]), -float(profile.tangent(end)[0, 0])
        to_axis = max(radius, 0.0) / inwards if inwards > 0.05 else np.inf
        meets = to_axis <= max(reach, snap)
        grown = profile.longer(0.0, to_axis if meets else reach, round and not meets)
        controls = grown.controls.copy()
        controls[-1, 0] = 0.0 if meets else controls[-1, 0]
        profile = replace(grown, controls=controls).reversed()
    return profile
