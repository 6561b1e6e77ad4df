"""How two surfaces meet along a chain: they cross, or they touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sed2cad.geometry.curves import Array
from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.primitives.vectors import unit

# Surfaces cross, or touch (their normals agree along the curve), or the place of the curve is open between
# them: next to a free-form surface, or between two faces of one surface, a chain rests where the mesh has it.
Meeting = Literal["crossing", "touching", "resting"]

SHALLOW = np.radians(15.0)  # wider angles between the normals always cross
LEVEL = np.radians(3.0)  # narrower ones never cross
REACH = 0.04  # unit frame: how far sideways the place where the normals agree may lie
_STEP = 1e-5  # unit frame: for differences of normals
_AROUND = _STEP * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Side:
    """A surface and which way is out: +1 when the outward normal is the primitive's, -1 when opposite."""

    primitive: Primitive
    sign: int

    @classmethod
    def of(cls, patch: FittedPatch) -> Side:
        """The side that the solid's face is."""
        return cls(patch.primitive, patch.sign)

    @property
    def free(self) -> bool:
        """Whether this is a free-form surface, which has no curvature to rely on."""
        return self.primitive.freeform

    @property
    def loose(self) -> bool:
        """Whether there is no surface on this side, because its face is being replaced."""
        return self.primitive.kind == "loose"

    def outward(self, points: Array) -> Array:
        """Outward unit normals (n, 3) at points (n, 3)."""
        return self.sign * self.primitive.normal(points)


@dataclass(frozen=True)
class Contact:
    """The difference of two normal fields, to first order, at n points."""

    difference: Array  # (n, 3)
    across: Array  # (n, 3): unit, the change of the difference (leading left singular vector)
    curvature: Array  # (n,): how much the difference changes per length
    sideways: Array  # (n, 3): unit, the way in which it changes most (leading right singular vector)


def relative_curvature(a: Side, b: Side, points: Array) -> Contact:
    """How fast the outward normals of a and b part from each other around points (n, 3).

    One rule for all pairs of tangent surfaces: where they touch, (n_a - n_b) . across = 0.
    """
    around = (points[:, None] + _AROUND).reshape(-1, 3)
    of_a, of_b = (side.outward(around).reshape(-1, len(_AROUND), 3) for side in (a, b))
    difference = of_a - of_b
    gradient = np.swapaxes(difference[:, 1:4] - difference[:, 4:], 1, 2) / (2 * _STEP)
    normal = unit(of_a[:, 0] + of_b[:, 0])
    flat = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    left, size, right = np.linalg.svd(flat @ gradient @ flat)
    return Contact(difference[:, 0], left[:, :, 0], size[:, 0], right[:, 0, :])


def angles(a: Side, b: Side, points: Array) -> Array:
    """Angles (n,) between the outward normals at the foot points of points (n, 3), radians."""
    one, other = (side.outward(side.primitive.project(points)) for side in (a, b))
    return np.arccos(np.clip(np.einsum("ij,ij->i", one, other), -1.0, 1.0))


def angle_along(a: Side, b: Side, points: Array) -> float:
    """The median angle between the outward normals along the middle of chain points (n, 3), radians."""
    return float(np.median(angles(a, b, middle(points))))


def middle(points: Array) -> Array:
    """Chain points (n, 3) without the ends, where other surfaces come in."""
    trim = len(points) // 6 if len(points) > 8 else 0
    return points[trim : len(points) - trim]


def touches(a: Side, b: Side, points: Array) -> bool:
    """Whether a and b may be tangent along the chain points (n, 3), rather than crossing at a shallow angle.

    Tangent surfaces have a place near by where their normals agree; a plane and a draft face of 5 degrees
    do not.
    """
    if a.primitive is b.primitive:
        return True
    angle = angle_along(a, b, points)
    if angle > SHALLOW or angle < LEVEL:
        return angle < LEVEL
    if a.free or b.free:
        return True
    return angle < REACH * float(np.median(relative_curvature(a, b, middle(points)).curvature))
