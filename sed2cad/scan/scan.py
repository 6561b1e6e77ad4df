"""The scan as every stage sees it: points, normals, perhaps a mesh, in the unit frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.neighbours import Array, search_tree

_AROUND = 12


@dataclass(frozen=True)
class Frame:
    """The unit frame: world = scale * unit + origin. The part's bounding box has its centre at 0, diagonal 1."""

    origin: Array  # (3,), world units
    scale: float  # diagonal of the part's bounding box, world units

    def to_unit(self, points: Array) -> Array:
        """World (n, 3) to unit frame."""
        return (points - self.origin) / self.scale

    def to_world(self, points: Array) -> Array:
        """Unit frame (n, 3) to world."""
        return points * self.scale + self.origin


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside."""

    vertices: Array  # (v, 3)
    faces: NDArray[np.int64]  # (f, 3)

    def face_normals(self) -> tuple[Array, Array]:
        """Unit normals (f, 3) and areas (f,)."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        cross = np.cross(b - a, c - a)
        double = np.linalg.norm(cross, axis=1)
        return cross / np.maximum(double, 1e-300)[:, None], double / 2

    def edge_lengths(self) -> Array:
        """Lengths (f, 3) of the edges from corner k to corner k + 1."""
        along = self.vertices[np.roll(self.faces, -1, axis=1)] - self.vertices[self.faces]
        return np.asarray(np.linalg.norm(along, axis=2))

    def centroids(self) -> Array:
        """Centres of the triangles (f, 3)."""
        return self.vertices[self.faces].mean(axis=1)

    def volume(self) -> float:
        """Signed volume (divergence theorem); positive when the triangles face outwards."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@dataclass(frozen=True)
class Scan:
    """What was measured, in the unit frame."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3), unit, outward
    mesh: Mesh | None  # the input mesh when there was one: it is the proxy for the topology
    frame: Frame
    noise: float  # standard deviation of the points along their normals, unit frame
    spacing: float  # median distance to the nearest neighbour, unit frame
    part: NDArray[np.int64] | None = None  # (n,) part of the mesh between sharp edges that each point lies on,
    triangle: NDArray[np.int64] | None = None  # and its triangle (n,); None unless a CAD system made the mesh

    @property
    def reach(self) -> float:
        """How far a proxy mesh may be from the points, unit frame."""
        return 1.5 * self.spacing + 4 * self.noise

    @cached_property
    def around(self) -> NDArray[np.int64]:
        """Indices (n, 13) of each point, which comes first, and of those nearest to it."""
        tree = search_tree(self.points)
        return np.asarray(tree.query(self.points, _AROUND + 1, workers=-1)[1], dtype=np.int64)
