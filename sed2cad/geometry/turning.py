"""Surfaces that close on themselves about an axis: angles around it, and where a seam is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sed2cad.geometry.curves import TURN, Array
from sed2cad.geometry.layout import Draft, Placement, Pole
from sed2cad.geometry.poles import sphere_pole
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.profile import Profile
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame


@dataclass(frozen=True)
class Turning:
    """A face on a surface that closes on itself about an axis: that axis and where the seam would be by default."""

    origin: Array  # (3,)
    z: Array  # (3,), unit
    x: Array  # (3,), unit, across z

    @classmethod
    def of(cls, draft: Draft, region: int) -> Turning | None:
        """The axis of a region's surface, or None where it has none."""
        primitive = draft.primitive(region)
        if isinstance(primitive, Sphere):
            loops = [[draft.edges[e].arc for e, _ in loop] for loop in draft.loops[region]]
            z, x = sphere_pole(primitive, loops, draft.topology.regions[region].points)
            return cls(primitive.centre, z, x)
        if isinstance(primitive, NetSurface):
            return Around.of_net(primitive) if primitive.closed else None
        if isinstance(primitive, BSplineSurface):
            if primitive.base == "plane":
                return None
            return cls(primitive.origin, primitive.frame[2], -primitive.frame[0])
        if isinstance(primitive, Cylinder):
            return cls(primitive.point, primitive.axis, _usual_x(primitive.axis))
        if isinstance(primitive, Cone):
            return cls(primitive.apex, primitive.axis, _usual_x(primitive.axis))
        if isinstance(primitive, Torus):
            return cls(primitive.centre, primitive.axis, _usual_x(primitive.axis))
        if isinstance(primitive, Revolution):
            return cls(primitive.origin, primitive.axis, _usual_x(primitive.axis))
        if isinstance(primitive, Extrusion) and primitive.profile.closed:
            return Sweeping(primitive.origin, primitive.direction, primitive.x_axis, primitive)
        return None

    def angles(self, points: Array) -> Array:
        """Angles (n,) about the axis from x, in (-pi, pi]."""
        offset = points - self.origin
        return np.arctan2(offset @ np.cross(self.z, self.x), offset @ self.x)

    def turned(self, angle: float) -> Turning:
        """The same with its seam at an angle from x."""
        return replace(self, x=np.cos(angle) * self.x + np.sin(angle) * np.cross(self.z, self.x))

    def placement(self, origin: Array, pole: Pole | None) -> Placement:
        return Placement(origin, self.z, self.x, pole)


@dataclass(frozen=True)
class Around(Turning):
    """A face on a closed control net: angles are shares of its period."""

    net: NetSurface
    seam: float = 0.0  # share of the period

    @classmethod
    def of_net(cls, net: NetSurface) -> Around:
        return cls(net.net.reshape(-1, 3).mean(axis=0), np.eye(3)[2], np.eye(3)[0], net)

    def angles(self, points: Array) -> Array:
        share = (self.net.foot(points)[:, 0] - self.net.domain[0][0]) / self.net.period
        return -wrapped(-TURN * (share - self.seam))

    def turned(self, angle: float) -> Around:
        return replace(self, seam=float(np.mod(self.seam + angle / TURN, 1.0)))

    def placement(self, origin: Array, pole: Pole | None) -> Placement:
        return Placement(origin, self.z, self.x, pole, self.seam)


@dataclass(frozen=True)
class Sweeping(Turning):
    """A face on an extruded closed profile; its angles are shares of the profile's length."""

    surface: Extrusion
    seam: float = 0.0  # radians from the profile's beginning

    def angles(self, points: Array) -> Array:
        return wrapped(share_of(self.surface.profile, self.surface.flat(points)) - self.seam)

    def turned(self, angle: float) -> Turning:
        profile = self.surface.profile
        low, high = profile.ends
        seam = self.seam + angle
        start = profile.at(np.array([low + seam / TURN * (high - low)]))[0]
        return replace(self, seam=seam, origin=self.surface.origin + start @ self.surface.axes)


def share_of(profile: Profile, flat: Array) -> Array:
    """Where along a closed profile the feet of points (n, 2) are, as angles (n,)."""
    low, high = profile.ends
    return np.asarray((profile.foot(flat) - low) * (TURN / (high - low)))


def _usual_x(axis: Array) -> Array:
    """The same direction for an axis and its opposite, so that coaxial faces share their seam."""
    strong = axis[int(np.argmax(np.abs(axis) > 0.5))]
    return tangent_frame(axis if strong > 0 else -axis)[0]


def wrapped(angles: Array) -> Array:
    """Angles brought into [-pi, pi)."""
    return np.mod(angles + np.pi, TURN) - np.pi
