"""Flat caps: the planes at which a scan ends, as that of the table a part stood on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.completion.gaps import Gap
from sed2cad.components import linked
from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.starts import weighted_plane
from sed2cad.scan.scan import Array, Scan

_NEAR = 1.0  # reaches: the scan ends so near to the plane
_OUTSIDE = 0.02  # share of the rim that may lie farther out
_LEAST = 0.15  # share of the rim that must be near, less what other caps explain
_LEAST_OF_LOOP = 0.5  # the same, of a loop,
_LARGE = 0.25  # which is this share of the gap at least
_SAME = np.cos(np.radians(5.0))
_MOST = 6
_APART = 3.0  # reaches between two loops of a rim
_INNER = 24  # points around one of the rim, most of them on the scan's side,
_LAYER = 3.0  # reaches between two caps
_DEEP = 0.1  # reaches from the plane on average
_ASKEW = 0.1  # cosine to the mean normal of the proxy in the gap: caps look more or less that way


@dataclass(frozen=True)
class Cap:
    """A plane that may close a gap, and the side of it that the scan is on: -1 below, +1 above as in a pocket."""

    patch: FittedPatch  # without points
    side: int
    whole: bool  # whether all of the rim is on that side, not only one of its loops, as around the head of a screw

    def is_within(self, points: Array, slack: float) -> NDArray[np.bool_]:
        """Which points (n, 3) are on the scan's side, or at most `slack` beyond."""
        return np.asarray(self.side * self.patch.primitive.distance(points) > -slack)

    def ends(self, surface: Primitive) -> bool:
        """Whether a surface ends at the plane, as it does not by itself: a cylinder that lies on it does."""
        if not self.whole:
            return False
        if isinstance(surface, Cylinder):
            return abs(float(surface.axis @ self.patch.primitive.normal(np.zeros((1, 3)))[0])) > _SAME
        return isinstance(surface, Plane | Cone)


def flat_caps(scan: Scan, gap: Gap, fitted: Sequence[FittedPatch]) -> list[Cap]:
    """Planes that have what can be seen around a gap, or around a loop of its rim, on one side, and a good part of its
    rim near them.

    They look along the directions that the part has, or as the whole rim does.
    """
    rim = scan.points[gap.rim]
    _, inner = cKDTree(scan.points).query(rim, k=_INNER)
    height = [(normal, rim @ normal, scan.points[inner] @ normal) for normal in _directions(scan, gap, fitted)]
    ways = [(told, loop, side) for loop in _loops(rim, gap) for told in height for side in (-1, 1)]
    candidates = [plane for told, loop, side in ways for plane in _supporting(*told, loop, side, gap.reach)]
    free = np.ones(len(rim), dtype=bool)
    found: list[Cap] = []
    for _ in range(_MOST):
        count = [int((free & plane.near).sum()) for plane in candidates]
        enough = [k for k, plane in enumerate(candidates) if count[k] >= plane.least]
        if not enough:
            break
        chosen = candidates[max(enough, key=lambda k: count[k])]
        own, free = free & chosen.near, free & ~chosen.near
        known = any(_is_same(chosen.plane, patch, gap) for patch in fitted)
        if not known and not any(_is_thin(chosen.plane, cap, gap) for cap in found):
            found.append(Cap(_as_patch(chosen.plane, rim[own], gap.reach), chosen.side, chosen.whole))
    return found


@dataclass(frozen=True)
class _Support:
    """A plane that has a loop of a rim (m,) on one side."""

    plane: Plane
    side: int
    near: NDArray[np.bool_]  # (m,) the points of the loop that are near it
    least: float  # how many there must be
    whole: bool  # whether the loop is the whole rim


def _loops(rim: Array, gap: Gap) -> list[NDArray[np.bool_]]:
    """All points of a rim (m, 3), and those of each large loop of it, where there are several."""
    number, part = linked(rim, _APART * gap.reach)
    loops = [part == k for k in range(number) if number > 1]
    large = [loop for loop in loops if np.linalg.norm(np.ptp(rim[loop], axis=0)) > _LARGE * 2 * gap.radius]
    return [np.ones(len(rim), dtype=bool), *large]


def _supporting(
    normal: Array, rim: Array, inner: Array, loop: NDArray[np.bool_], side: int, reach: float
) -> list[_Support]:
    """The plane that has a loop of the rim, but for strays, on one side.

    rim (m,), inner (m, k): heights of the rim and of the points around each of its own. None where these are on the
    other side.
    """
    offset = float(np.quantile(rim[loop], 1 - _OUTSIDE if side < 0 else _OUTSIDE))
    near = loop & (np.abs(rim - offset) < _NEAR * reach)
    if not near.any() or side * (inner[near].mean() - offset) < _DEEP * reach:
        return []
    whole = bool(loop.all())
    least = max((_LEAST if whole else _LEAST_OF_LOOP) * float(loop.sum()), 3.0)
    return [_Support(Plane(normal, offset), side, near, least, whole)]


def _directions(scan: Scan, gap: Gap, fitted: Sequence[FittedPatch]) -> list[Array]:
    """Outward unit normals (k, 3) that a cap may have, the different ones only."""
    found: list[Array] = []
    rim, normals = scan.points[gap.rim], scan.normals[gap.rim]
    axes = [_axis(patch) for patch in sorted(fitted, key=lambda patch: -len(patch.patch.indices))]
    axes.append(weighted_plane(rim, normals, np.ones(len(rim))).normal_vector)
    for axis in axes:
        if axis is None or abs(axis @ gap.outwards) < _ASKEW or any(abs(axis @ other) > _SAME for other in found):
            continue
        found.append(axis * np.sign(axis @ gap.outwards))
    return found


def _axis(patch: FittedPatch) -> Array | None:
    primitive = patch.primitive
    if isinstance(primitive, Plane):
        return primitive.normal_vector
    return primitive.axis if isinstance(primitive, Cylinder | Cone) else None


def _is_same(plane: Plane, patch: FittedPatch, gap: Gap) -> bool:
    """Whether a cap is the plane of a face that there is."""
    other = patch.primitive
    if not isinstance(other, Plane) or patch.sign * other.normal_vector @ plane.normal_vector < _SAME:
        return False
    apart = patch.sign * other.distance(gap.centre[None]) - plane.distance(gap.centre[None])
    return abs(float(apart[0])) < gap.reach


def _is_thin(plane: Plane, cap: Cap, gap: Gap) -> bool:
    """Whether a plane would leave only a thin layer in front of a larger cap: the floor of a hole that goes through."""
    other = cap.patch.primitive
    assert isinstance(other, Plane)
    if abs(other.normal_vector @ plane.normal_vector) < _SAME:
        return False
    return abs(float(other.distance(plane.project(gap.centre[None]))[0])) < _LAYER * gap.reach


def _as_patch(plane: Plane, own: Array, reach: float) -> FittedPatch:
    """The plane without points, as uncertain as the rim that it was found by."""
    spread = reach**2 * np.diag([1 / max(float(np.ptp(own, axis=0).max()), reach) ** 2] * 2 + [1.0])
    nothing = Patch(np.zeros(0, dtype=np.int64), "plane", np.zeros(0, dtype=bool))
    return FittedPatch(nothing, plane, 1, reach, spread)
