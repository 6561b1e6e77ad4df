"""No surface at all: what carries a face that is going to be replaced by facets, or left out where the scan ends.

Every point lies on it and it faces nowhere, so the edges and corners around it follow the other faces alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sed2cad.primitives.base import Array, FittedPatch, Patch, Primitive


@dataclass(frozen=True, eq=False)
class Loose(Primitive):
    """Distance 0 everywhere."""

    kind: ClassVar[str] = "loose"
    freedom: ClassVar[int] = 0

    def distance(self, points: Array) -> Array:
        return np.zeros(len(points))

    def normal(self, points: Array) -> Array:
        return np.zeros_like(points)

    def moved(self, delta: Array) -> Self:
        return self

    def jacobian(self, points: Array) -> Array:
        return np.zeros((len(points), 0))

    def scaled(self, scale: float, origin: Array) -> Self:
        return self

    def parameters(self) -> dict[str, Any]:
        return {}

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        return cls()


def loose_among(fitted: Sequence[FittedPatch]) -> int | None:
    """The first patch without a surface; None where there is none."""
    return next((k for k, patch in enumerate(fitted) if isinstance(patch.primitive, Loose)), None)


def loose_patch() -> FittedPatch:
    """A patch without points on no surface."""
    nothing = Patch(np.zeros(0, np.int64), "loose", np.zeros(0, bool))
    return FittedPatch(nothing, Loose(), 1, 0.0, np.zeros((0, 0)))
