"""What every primitive (parametric surface) can do.

A primitive is immutable and unbounded. Its signed distance is positive on the side its normal points to;
whether that side is outside the part is the `sign` of the fitted patch, not the primitive's business.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNLABELLED = -1


def side_of(there: Array, normals: Array) -> int:
    """+1 where normals (n, 3) mostly agree with those of a surface there (n, 3), -1 where they oppose."""
    return 1 if np.median(np.einsum("ij,ij->i", there, normals)) >= 0 else -1


class Primitive(ABC):
    """A surface with a signed distance.

    Small changes live in a local chart of `freedom` numbers around the primitive: `moved(delta)` gives the
    changed primitive, `jacobian(points)` the derivative of `distance` by delta at delta = 0. Angles in delta
    are radians, lengths are in the unit of the points.
    """

    kind: ClassVar[str]  # "plane", "cylinder", "cone", "sphere", "torus", "bspline", "extrusion", "revolution"
    freedom: ClassVar[int]  # length of delta; 0 where the shape is not a parameter vector (B-spline)
    freeform: ClassVar[bool] = False  # whether a spline shapes it, so that its curvature is not to be relied on

    @abstractmethod
    def distance(self, points: Array) -> Array:
        """Signed distance (n,) of points (n, 3)."""

    @abstractmethod
    def normal(self, points: Array) -> Array:
        """Gradient of the distance at points (n, 3): unit vectors (n, 3)."""

    def distance_and_normal(self, points: Array) -> tuple[Array, Array]:
        """Both at once, for primitives that find one on the way to the other."""
        return self.distance(points), self.normal(points)

    def project(self, points: Array) -> Array:
        """Foot points (n, 3) on the surface."""
        return points - self.distance(points)[:, None] * self.normal(points)

    def side(self, points: Array, normals: Array) -> int:
        """+1 where the normals (n, 3) at points (n, 3) mostly agree with the primitive's, -1 where they oppose."""
        return side_of(self.normal(points), normals)

    def angles(self, points: Array, normals: Array) -> Array:
        """Angles (n,) between normals (n, 3) at points (n, 3) and the primitive's, radians, on the side they are on."""
        cosine = np.einsum("ij,ij->i", self.normal(points), normals) * self.side(points, normals)
        return np.asarray(np.sqrt(np.maximum(2 - 2 * cosine, 0.0)))

    @abstractmethod
    def moved(self, delta: Array) -> Self:
        """The primitive changed by delta (freedom,) in its local chart."""

    @abstractmethod
    def jacobian(self, points: Array) -> Array:
        """d distance / d delta at points (n, 3): (n, freedom)."""

    @abstractmethod
    def scaled(self, scale: float, origin: Array) -> Self:
        """The primitive under p -> scale * p + origin (unit frame to world; invert for the way back)."""

    @abstractmethod
    def parameters(self) -> dict[str, Any]:
        """Named numbers (float or tuple of 3 floats) for people, JSON and `from_parameters`."""

    @classmethod
    @abstractmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        """Inverse of `parameters`. ValueError where a number is missing or makes no sense (radius <= 0)."""


@dataclass(frozen=True)
class Patch:
    """Points of one surface."""

    indices: NDArray[np.int64]  # into scan.points
    kind: str  # the type the network or the refinement gives it
    interior: NDArray[np.bool_]  # same length: not an edge point


@dataclass(frozen=True)
class FittedPatch:
    """A patch and the primitive that explains it."""

    patch: Patch
    primitive: Primitive
    sign: int  # +1 when the outward normal is the primitive's normal, -1 when it is opposite (a bore)
    rms: float  # of the interior points' distances, unit frame
    covariance: Array  # (freedom, freedom) in the primitive's chart, of the pose if swept; (0, 0) for B-splines
    tied: bool = False  # to the axis of a patch beside it, as its own points are too few to tell one


def point_labels(count: int, fitted: Sequence[FittedPatch]) -> NDArray[np.int64]:
    """Index of the fitted patch of each of `count` points (count,), or UNLABELLED."""
    labels = np.full(count, UNLABELLED, dtype=np.int64)
    for index, patch in enumerate(fitted):
        labels[patch.patch.indices] = index
    return labels
