"""Triangle meshes as half-edges: who is whose neighbour, and how to make a closed mesh manifold.

Half-edge 3 * t + k runs from corner k to corner k + 1 of triangle t.
"""

from __future__ import annotations

import numpy as np
from gpytoolbox import squared_distance
from numpy.typing import NDArray

from sed2cad.components import components
from sed2cad.scan.scan import Array, Mesh

Faces = NDArray[np.int64]
Index = NDArray[np.int64]


def half_edges(faces: Faces) -> tuple[Index, Index]:
    """Origins and targets (3 f,) of the half-edges."""
    return faces.ravel(), faces[:, [1, 2, 0]].ravel()


def following(half_edge: Index) -> Index:
    """The next half-edges of the same triangles."""
    return half_edge - half_edge % 3 + (half_edge + 1) % 3


def twins(faces: Faces) -> Index:
    """The opposite half-edge (3 f,) of each half-edge; -1 where there is none or more than one."""
    origin, target = half_edges(faces)
    key = np.minimum(origin, target) * (int(faces.max(initial=0)) + 1) + np.maximum(origin, target)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    fresh = np.flatnonzero(np.diff(ordered, prepend=-1))  # where the half-edges of each edge begin
    pairs = fresh[np.diff(fresh, append=len(ordered)) == 2]
    one, other = order[pairs], order[pairs + 1]
    opposite = origin[one] == target[other]
    found = np.full(len(key), -1, dtype=np.int64)
    found[one[opposite]], found[other[opposite]] = other[opposite], one[opposite]
    return found


def is_closed_manifold(faces: Faces) -> bool:
    """Whether every edge has two triangles, consistently oriented, and every vertex one fan."""
    twin = twins(faces)
    return len(faces) > 0 and bool((twin >= 0).all()) and _fans(faces, twin)[0] == len(np.unique(faces))


def _fans(faces: Faces, twin: Index) -> tuple[int, Index]:
    """Corners of triangles grouped into fans around a vertex: how many, and the fan (3 f,) of each corner."""
    corner = np.arange(3 * len(faces))
    return components(len(corner), np.column_stack([corner, following(twin)]))


def split_fans(vertices: Array, faces: Faces, twin: Index) -> Mesh:
    """The mesh with one vertex for each fan: pinched vertices come apart. twin must be complete.

    Two edges that still join the same two vertices get a vertex in the middle each.
    """
    number, fan = _fans(faces, twin)
    origin = np.zeros(number, dtype=np.int64)
    origin[fan] = faces.ravel()
    mesh = Mesh(vertices[origin], fan.reshape(-1, 3))
    return split_edges(mesh, twin, twins(mesh.faces) < 0)


def split_edges(mesh: Mesh, twin: Index, marked: NDArray[np.bool_]) -> Mesh:
    """The mesh with a vertex in the middle of the marked edges; marked (3 f,) is the same for twins."""
    halves = np.flatnonzero(marked)
    edges, which = np.unique(np.minimum(halves, twin[halves]), return_inverse=True)
    if len(edges) == 0:
        return mesh
    origin, target = half_edges(mesh.faces)
    middles = (mesh.vertices[origin[edges]] + mesh.vertices[target[edges]]) / 2
    middle = np.full(len(twin), -1, dtype=np.int64)
    middle[halves] = len(mesh.vertices) + which
    vertices = np.vstack([mesh.vertices, middles])
    faces, middle = _turned(mesh.faces, middle.reshape(-1, 3))
    count = (middle >= 0).sum(axis=1)
    corners = np.hstack([faces, middle])  # a b c, then the middles of ab bc ca
    pieces = [faces[count == 0]]
    for number, pattern in _PATTERNS.items():
        pieces.append(corners[count == number][:, pattern].reshape(-1, 3))
    return Mesh(vertices, np.vstack(pieces))


_PATTERNS = {
    1: [0, 3, 2, 3, 1, 2],
    2: [3, 1, 4, 0, 3, 4, 0, 4, 2],
    3: [0, 3, 5, 3, 1, 4, 5, 4, 2, 3, 4, 5],
}  # the pieces of a triangle whose first 1, 2 or 3 edges have a middle


def _turned(faces: Faces, middle: Index) -> tuple[Faces, Index]:
    """Triangles and middles of their edges (f, 3), turned so that the edges with a middle come first."""
    has = middle >= 0
    count = has.sum(axis=1)
    first = np.where(count == 1, has.argmax(axis=1), 0)
    first = np.where(count == 2, (has.argmin(axis=1) + 1) % 3, first)
    turn = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(faces, turn, axis=1), np.take_along_axis(middle, turn, axis=1)


def used(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no triangle uses."""
    kept, faces = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[kept], faces.reshape(-1, 3).astype(np.int64))


def bodies(faces: Faces) -> tuple[int, Index]:
    """Connected components of triangles, across shared vertices: how many, and the component (f,) of each."""
    if len(faces) == 0:
        return 0, np.zeros(0, dtype=np.int64)
    _, component = components(int(faces.max()) + 1, np.vstack([faces[:, :2], faces[:, 1:]]))
    number, body = np.unique(component[faces[:, 0]], return_inverse=True)
    return len(number), body.astype(np.int64)


def euler_number(faces: Faces) -> int:
    """V - E + F of a closed manifold: 2 for each body less 2 for each handle."""
    return int(np.count_nonzero(np.bincount(faces.ravel()))) - len(faces) // 2


def nearest_triangles(mesh: Mesh, points: Array) -> tuple[Array, NDArray[np.int64]]:
    """Distance (n,) of points (n, 3) from a mesh, and the triangle (n,) that each is nearest to."""
    squared, triangle, _ = squared_distance(
        points, mesh.vertices, F=mesh.faces.astype(np.int32), use_cpp=True, use_aabb=True
    )
    return np.sqrt(squared), triangle.astype(np.int64)
