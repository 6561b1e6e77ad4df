"""Triangles between loops in space that follow a cloud of points: the facets of one face.

The loops are joined by bridges to one polygon, which is cut into the triangles that lie nearest to the cloud
(dynamic programming; Barequet and Sharir 1995, Filling gaps in the boundary of a polyhedron). Where the cloud
bulges out between them, points of it are added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.errors import AssemblyError
from sed2cad.geometry.curves import Array

Index = NDArray[np.int64]
Corner = tuple[int, int]  # (vertex, name of the side from here to the next corner)

MOST_CORNERS = 130  # of a polygon: the effort grows with their cube
_NEAR = 0.01  # unit frame: triangles farther from the cloud are bad
_FLAT = 2e-4  # unit frame: triangles of less height are slivers
_SLIVER = 10.0  # what a sliver costs
_FORBIDDEN = 1e6


@dataclass(frozen=True)
class Cloud:
    """Points spread densely over a face, and the outward normals there. Unit frame."""

    points: Array  # (m, 3)
    normals: Array  # (m, 3)

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.points)


@dataclass
class Polygon:
    """A polygon of corners in space and the triangles that fill it.

    Sides are named: those of the loops by the caller (>= 0), bridges by negative numbers, each met twice.
    """

    corners: list[Corner]
    points: list[Array]  # (3,) of each corner, then of each point added inside
    triangles: list[tuple[int, int, int]] = field(default_factory=list)  # of corners and added points


def filled(loops: Sequence[Sequence[Corner]], vertices: Array, cloud: Cloud) -> Polygon:
    """The triangles between loops (their face on the left) that follow the cloud.

    AssemblyError for faces without loops or with too many corners.
    """
    corners = joined(loops, vertices, cloud)
    if not 3 <= len(corners) <= MOST_CORNERS:
        raise AssemblyError(f"a face with {len(corners)} corners cannot be cut into facets")
    polygon = Polygon(corners, [vertices[v] for v, _ in corners])
    polygon.triangles = _cut(np.array(polygon.points), np.array([v for v, _ in corners]), cloud)
    return polygon


def joined(loops: Sequence[Sequence[Corner]], vertices: Array, cloud: Cloud) -> list[Corner]:
    """All loops as one, over bridges between near corners; loops that share a vertex are joined there."""
    rest = sorted((list(loop) for loop in loops), key=len)
    whole = rest.pop() if rest else []
    bridge = -1
    while rest:
        _, which, a, b = min(_bridges(whole, loop, n, vertices, cloud) for n, loop in enumerate(rest))
        other = rest.pop(which)
        other = other[b:] + other[:b]
        if whole[a][0] == other[0][0]:
            whole = whole[:a] + other + whole[a:]
        else:
            whole = [*whole[:a], (whole[a][0], bridge), *other, (other[0][0], bridge), *whole[a:]]
            bridge -= 1
    return whole


def _bridges(
    whole: Sequence[Corner], loop: Sequence[Corner], number: int, vertices: Array, cloud: Cloud
) -> tuple[float, int, int, int]:
    """The cheapest bridge to a loop: its cost, the loop's number, and the two corners."""
    ours, theirs = (vertices[[v for v, _ in corners]] for corners in (whole, loop))
    length = np.linalg.norm(ours[:, None] - theirs[None], axis=2)
    off, _ = cloud.tree.query((ours[:, None] + theirs[None]) / 2)
    cost = length + 5 * off
    a, b = np.unravel_index(int(cost.argmin()), cost.shape)
    return float(cost[a, b]), number, int(a), int(b)


def price(a: Array, b: Array, c: Array, cloud: Cloud) -> Array:
    """What triangles (n, 3) each cost: area, more where the cloud is far or faces another way."""
    across = np.cross(b - a, c - a)
    double = np.linalg.norm(across, axis=1)
    longest = np.max([np.linalg.norm(q - p, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    off, nearest = cloud.tree.query((a + b + c) / 3)
    cosine = np.einsum("ij,ij->i", across, cloud.normals[nearest]) / np.maximum(double, 1e-300)
    far = np.minimum((off / _NEAR) ** 2, 100.0)
    sliver = double < _FLAT * longest
    return np.asarray(double / 2 * (0.2 + far + 3 * (1 - cosine)) + _SLIVER * sliver)


def _cut(points: Array, vertex: Index, cloud: Cloud) -> list[tuple[int, int, int]]:
    """The cheapest triangles (corner numbers) of a polygon of points (n, 3)."""
    count = len(points)
    diagonals = _diagonals(points, vertex, cloud)
    best = np.zeros((count, count))
    choice = np.zeros((count, count), dtype=np.int64)
    for gap in range(2, count):
        i = np.repeat(np.arange(count - gap), gap - 1)
        k = i + np.tile(np.arange(1, gap), count - gap)
        j = i + gap
        cost = price(points[i], points[k], points[j], cloud) + best[i, k] + best[k, j]
        cost = cost.reshape(-1, gap - 1)
        first = cost.argmin(axis=1)
        rows = np.arange(count - gap)
        ends = rows + gap
        extra = diagonals[rows, ends] if gap < count - 1 else 0.0
        best[rows, ends] = cost[rows, first] + extra
        choice[rows, ends] = rows + 1 + first
    found, todo = [], [(0, count - 1)]
    while todo:
        a, b = todo.pop()
        if b - a > 1:
            middle = int(choice[a, b])
            found.append((a, middle, b))
            todo += [(a, middle), (middle, b)]
    return found


def _diagonals(points: Array, vertex: Index, cloud: Cloud) -> Array:
    """What a side between two corners costs (n, n), from its way through thin air."""
    ends = points[:, None], points[None]
    length = np.linalg.norm(ends[0] - ends[1], axis=2)
    off = np.max([cloud.tree.query((1 - t) * ends[0] + t * ends[1])[0] for t in (0.25, 0.5, 0.75)], axis=0)
    cost = 0.3 * length**2 * np.minimum((off / _NEAR) ** 2, 100.0)
    return np.where(vertex[:, None] == vertex[None], _FORBIDDEN, cost)
