"""How far the scan's points lie from the solid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.TopAbs import TopAbs_REVERSED
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape
from scipy.spatial import cKDTree

from sed2cad.brep.kernel import Array, faces
from sed2cad.geometry.triangles import point_triangle
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.vectors import root_mean_square

_ANGLE = 0.3  # radians between neighbouring triangles
_BLUR = 3.0  # deflections between a face and its triangles: the kernel takes its limit loosely
_SPREAD = 8_000  # points on the solid
_PAIRS = 200_000  # point-triangle pairs looked at in one go


@dataclass(frozen=True)
class Triangles:
    """A tessellated shape."""

    vertices: Array  # (v, 3)
    triangles: NDArray[np.int64]  # (t, 3), counter-clockwise from outside
    owner: NDArray[np.int64]  # (t,): number of the face among the shape's faces

    def corners(self) -> tuple[Array, Array, Array]:
        """The three corners (t, 3) of each triangle."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        return a, b, c


@dataclass(frozen=True)
class Deviations:
    """Distance of each point from the solid and the face it is nearest to."""

    distances: Array  # (n,)
    faces: NDArray[np.int64]  # (n,): number of the face among the shape's faces
    mesh: Triangles  # the tessellated solid

    def stray(self, surface: Array) -> float:
        """Largest distance of the solid from the nearest of the points (m, 3), but for its farthest 0.1 %."""
        distances, _ = cKDTree(surface).query(spread_over(self.mesh, _SPREAD)[0])
        return float(np.quantile(distances, 0.999))

    @property
    def rms(self) -> float:
        return root_mean_square(self.distances)

    @property
    def p95(self) -> float:
        return float(np.quantile(self.distances, 0.95))

    @property
    def max(self) -> float:
        return float(self.distances.max())

    def rms_by_face(self, count: int) -> Array:
        """Rms (count,) per face; NaN for faces without points."""
        points = np.bincount(self.faces, minlength=count)
        square = np.bincount(self.faces, self.distances**2, minlength=count)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(square / points))


def tessellate(shape: TopoDS_Shape, deflection: float) -> Triangles:
    """Triangles within `deflection` of a valid shape. (An invalid one can keep the kernel busy for ever.)"""
    BRepTools.Clean_s(shape)
    BRepMesh_IncrementalMesh(shape, deflection, False, _ANGLE, False)
    vertices, triangles, owner, offset = [], [], [], 0
    for number, face in enumerate(faces(shape)):
        nodes, corners = _face_triangles(face)
        vertices.append(nodes)
        triangles.append(corners + offset)
        owner.append(np.full(len(corners), number))
        offset += len(nodes)
    return Triangles(np.vstack(vertices), np.vstack(triangles), np.concatenate(owner))


def _face_triangles(face: TopoDS_Face) -> tuple[Array, NDArray[np.int64]]:
    """Nodes (n, 3) and triangles (t, 3) of a tessellated face; empty where the kernel made none."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    move = location.Transformation()
    nodes = [mesh.Node(k).Transformed(move) for k in range(1, mesh.NbNodes() + 1)]
    corners = np.array([mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)], np.int64) - 1
    if face.Orientation() == TopAbs_REVERSED:
        corners = corners[:, ::-1]
    return np.array([(p.X(), p.Y(), p.Z()) for p in nodes]), corners.reshape(-1, 3)


def deviations(
    shape: TopoDS_Shape, primitives: Sequence[Primitive | None], points: Array, deflection: float
) -> Deviations:
    """Distances of points (n, 3) from a valid shape whose faces lie on `primitives` (None: unknown).

    The nearest triangle tells the face; the distance is then that from the face's own surface, so that it
    is not blurred by the tessellation, except for points beyond the face's border.
    """
    mesh = tessellate(shape, deflection)
    distances, nearest = nearest_triangles(points, mesh)
    owner = mesh.owner[nearest]
    for number, primitive in enumerate(primitives):
        mine = np.flatnonzero(owner == number)
        if primitive is None or len(mine) == 0:
            continue
        exact = np.abs(primitive.distance(points[mine]))
        inside = np.abs(distances[mine] - exact) < _BLUR * deflection
        distances[mine] = np.where(inside, exact, distances[mine])
    return Deviations(distances, owner, mesh)


def spread_over(mesh: Triangles, count: int) -> tuple[Array, NDArray[np.int64]]:
    """Points (count, 3) spread evenly over the triangles, always the same ones, and the triangle of each."""
    rng = np.random.default_rng(0)
    a, b, c = mesh.corners()
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    pick = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[pick] + u * (b - a)[pick] + v * (c - a)[pick], pick


def nearest_triangles(points: Array, mesh: Triangles) -> tuple[Array, NDArray[np.int64]]:
    """Distance (n,) of points (n, 3) to the nearest triangle, and its number (n,). Exact.

    Triangles are looked at by size, the large ones first: what is near to them need not look far for small
    ones.
    """
    corners = mesh.corners()
    centres = (corners[0] + corners[1] + corners[2]) / 3
    radii = np.max([np.linalg.norm(corner - centres, axis=1) for corner in corners], axis=0)
    size = np.floor(np.log2(np.maximum(radii, 1e-300)))
    to_vertices: Array = cKDTree(mesh.vertices[np.unique(mesh.triangles)]).query(points)[0]
    distances = to_vertices * (1 + 1e-9) + 1e-300
    numbers = np.full(len(points), -1, np.int64)
    for level in np.unique(size)[::-1]:
        chosen = np.flatnonzero(size == level)
        for at, triangle in _near_pairs(points, distances, centres, radii, chosen):
            off = point_triangle(points[at], *(corner[triangle] for corner in corners))
            order = np.lexsort((off, at))
            best = order[np.flatnonzero(np.diff(at[order], prepend=-1))]  # the nearest for each point
            best = best[off[best] <= distances[at[best]]]
            distances[at[best]], numbers[at[best]] = off[best], triangle[best]
    return distances, numbers


def _near_pairs(
    points: Array, reach: Array, centres: Array, radii: Array, chosen: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Numbers of points and chosen triangles, in batches, where the triangle may come within reach (n,)."""
    tree = cKDTree(centres[chosen])
    largest = float(radii[chosen].max())
    batch = max(1, _PAIRS // len(chosen))
    for first in range(0, len(points), batch):
        part = np.arange(first, min(first + batch, len(points)))
        found = tree.query_ball_point(points[part], reach[part] + largest)
        at = np.repeat(part, [len(near) for near in found])
        if len(at):
            yield at, chosen[np.concatenate([np.asarray(near, np.int64) for near in found])]
