"""Triangle soups to meshes: corners welded, triangles wound outwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.scan.scan import Array, Mesh

TOLERANCE = 1e-5
"""Corners nearer than this (in diagonals) are welded where that closes gaps."""
FLAT = float(np.radians(1.0))
"""Turn of an edge between triangles of one plane, at most."""
_COPLANAR = np.radians(0.2)
_HALF = 0.65  # of a strip's arc, where strips differ a little
_COARSEST = 3e-3  # diagonals: no round surface is this far off its triangles
_NEARLY_ALL = 0.9
_UNUSUAL = 2.0  # times what nearly all edges of round surfaces turn and lie off


def weld(mesh: Mesh) -> Mesh:
    """Corners at one place made one vertex; degenerate and duplicate triangles, unused vertices dropped."""
    places, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    exact = _tidy(places, number.ravel()[mesh.faces])
    if is_closed(exact):
        return exact
    limit = TOLERANCE * float(np.linalg.norm(np.ptp(exact.vertices, axis=0)))
    pairs = cKDTree(exact.vertices).query_pairs(limit, output_type="ndarray")
    if not len(pairs):
        return exact
    group = components(len(exact.vertices), pairs)[1]
    first = np.unique(group, return_index=True)[1]
    near = _tidy(exact.vertices[first], group[exact.faces])
    return near if _open_edges(near) < _open_edges(exact) else exact


def is_closed(mesh: Mesh) -> bool:
    """True when every edge has two triangles (or an even number)."""
    return len(mesh.faces) > 0 and _open_edges(mesh) == 0


def wound_outwards(mesh: Mesh) -> Mesh:
    """Neighbouring triangles wound alike; closed bodies outwards, closed cavities in them inwards.

    Open parts keep the winding that most of their area has.
    """
    halves, same = _neighbours(mesh)
    pairs, f = halves // 3, len(mesh.faces)
    count, part = components(f, pairs)
    turn = _alike(f, pairs, same, part)
    area = mesh.face_normals()[1]
    turn *= np.where(np.bincount(part, turn * area, count) < 0, -1, 1)[part]
    faces = np.where(turn[:, None] < 0, mesh.faces[:, ::-1], mesh.faces)
    bodies = [Mesh(mesh.vertices, faces[part == p]) for p in range(count)] if count < 200 else []
    for p, body in enumerate(bodies):
        if is_closed(body):
            others = [b for q, b in enumerate(bodies) if q != p and is_closed(b)]
            depth = sum(_inside(mesh.vertices[body.faces[0, 0]], body, other) for other in others)
            if (body.volume() < 0) != (depth % 2 == 1):
                faces[part == p] = faces[part == p][:, ::-1]
    return Mesh(mesh.vertices, faces)


def is_measured(mesh: Mesh) -> bool:
    """Whether the triangles come from a scanner, not from a CAD system.

    Noise bends the edges of most of them both ways; a CAD system leaves most of them a neighbour in the same plane, or
    bends a round surface one way.
    """
    halves, same = _neighbours(mesh)
    pairs = halves // 3
    normals, area = mesh.face_normals()
    centres = mesh.centroids()
    angle = _angles_between(normals, pairs, same)
    up = np.einsum("ij,ij->i", centres[pairs[:, 1]] - centres[pairs[:, 0]], normals[pairs[:, 0]]) > 0
    flat, convex, concave = (np.zeros(len(area), bool) for _ in range(3))
    flat[pairs[angle < _COPLANAR]] = True
    convex[pairs[(angle > FLAT) & ~up]] = True
    concave[pairs[(angle > FLAT) & up]] = True
    return bool(area[convex & concave].sum() > area[flat].sum())


def _angles_between(normals: Array, pairs: NDArray[np.int64], same: NDArray[np.int64]) -> Array:
    """Radians (m,) between the normals of pairs of triangles that are wound alike (1) or not (-1)."""
    cosine = same * np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))


def smooth_edges(mesh: Mesh, degrees: float) -> NDArray[np.int64]:
    """Half-edges (m, 2) of the edges that are not sharp; half-edge 3 t + k starts at corner k of triangle t.

    Sharp are edges that turn more than `degrees`; those whose triangles lie farther off the arc that would go through
    them than in the coarsest mesh; and those that turn more, and lie farther off, than nearly all others do: a plane
    that meets a cone at 20 degrees is no coarse cylinder.
    """
    halves, same = _neighbours(mesh)
    pairs = halves // 3
    normals, area = mesh.face_normals()
    angle = _angles_between(normals, pairs, same)
    height = 2 * area[pairs].min(axis=1) / np.maximum(_lengths(mesh)[halves[:, 0]], 1e-300)
    sagitta = height * angle / 8 / np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    smooth = (angle < np.radians(degrees)) & (sagitta < _COARSEST)
    bent = smooth & (angle > FLAT)
    if bent.any():
        usual = [np.quantile(values[bent], _NEARLY_ALL) for values in (angle, sagitta)]
        smooth &= (angle < _UNUSUAL * usual[0]) | (sagitta < _UNUSUAL * usual[1])
    return halves[smooth]


def smooth_parts(mesh: Mesh, smooth: NDArray[np.int64]) -> tuple[int, NDArray[np.int64]]:
    """Parts that hang together over smooth edges: their count, and (f,) the part of each triangle."""
    return components(len(mesh.faces), smooth // 3)


def smooth_fans(mesh: Mesh, smooth: NDArray[np.int64]) -> NDArray[np.int64]:
    """Corners (f, 3) of triangles at one vertex that hang together over smooth edges: the fan of each."""
    end = smooth - smooth % 3 + (smooth + 1) % 3
    corner = mesh.faces.ravel()
    alike = corner[smooth[:, 0]] == corner[smooth[:, 1]]
    first = np.column_stack([smooth[:, 0], np.where(alike, smooth[:, 1], end[:, 1])])
    second = np.column_stack([end[:, 0], np.where(alike, end[:, 1], smooth[:, 1])])
    return components(len(corner), np.vstack([first, second]))[1].reshape(-1, 3)


def planar_facets(mesh: Mesh, degrees: float) -> NDArray[np.int64]:
    """The plane (f,) that each triangle is sure to lie on, -1 for none; edges that turn more than `degrees` are sharp.

    Coplanar triangles are a face or a strip of a round one. Between strips an edge turns by one strip's arc, between a
    plane and the first strip by half of that.
    """
    halves, same = _neighbours(mesh)
    pairs, normals = halves // 3, mesh.face_normals()[0]
    level = _angles_between(normals, pairs, same) < _COPLANAR
    count, facet = components(len(mesh.faces), pairs[level])
    smooth = smooth_edges(mesh, degrees) // 3
    turn = _angles_between(normals, smooth, np.ones(len(smooth), np.int64))
    bent = facet[smooth[turn >= _COPLANAR]]
    turn = np.repeat(turn[turn >= _COPLANAR], 2)
    here, there = bent.ravel(), bent[:, ::-1].ravel()
    most = np.zeros(count)
    np.maximum.at(most, here, turn)
    sure = np.bincount(facet, minlength=count) > 1
    np.logical_and.at(sure, here, turn < _HALF * most[there])
    return np.where(sure[facet], facet, -1)


def border_lengths(mesh: Mesh, parts: int, part: NDArray[np.int64]) -> Array:
    """Length (parts,) of the border of each part of the mesh; part (f,) of each triangle."""
    key, _, face = _half_edges(mesh)
    number, count = np.unique(key * np.int64(parts) + part[face], return_inverse=True, return_counts=True)[1:]
    alone = count[number.ravel()] == 1
    return np.asarray(np.bincount(part[face[alone]], _lengths(mesh)[alone], parts))


def _lengths(mesh: Mesh) -> Array:
    """Lengths (3 f,) of the half-edges."""
    corners = mesh.vertices[mesh.faces]
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).ravel())


def _tidy(vertices: Array, faces: NDArray[np.int64]) -> Mesh:
    corners = np.sort(faces, axis=1)
    proper = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    faces, corners = faces[proper], corners[proper]
    faces = faces[np.sort(np.unique(corners, axis=0, return_index=True)[1])]
    used, number = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], number.reshape(-1, 3).astype(np.int64))


def _half_edges(mesh: Mesh) -> tuple[NDArray, NDArray, NDArray]:
    """Keys (3 f,) of the edges, whether each is walked upwards, and its triangle."""
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    key = np.minimum(start, end) * np.int64(len(mesh.vertices)) + np.maximum(start, end)
    return key, start < end, np.repeat(np.arange(len(mesh.faces)), 3)


def _open_edges(mesh: Mesh) -> int:
    count = np.unique(_half_edges(mesh)[0], return_counts=True)[1]
    return int((count % 2).sum())


def _neighbours(mesh: Mesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Half-edges (m, 2) of edges with two triangles and no third; 1 where these are wound alike, else -1."""
    key, upward, _ = _half_edges(mesh)
    order = np.argsort(key, kind="stable")
    key, upward = key[order], upward[order]
    starts = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    twice = starts[np.diff(np.r_[starts, len(key)]) == 2]
    alike = upward[twice] != upward[twice + 1]
    return np.column_stack([order[twice], order[twice + 1]]), np.where(alike, 1, -1)


def _alike(f: int, pairs: NDArray, same: NDArray, part: NDArray) -> NDArray[np.int64]:
    """1 or -1 (f,) for every triangle, so that neighbours are wound alike when those with -1 are turned."""
    roots = np.unique(part, return_index=True)[1]
    rows, columns = np.r_[pairs[:, 0], np.full(len(roots), f)], np.r_[pairs[:, 1], roots]
    graph = csr_matrix((np.r_[same + 3, np.full(len(roots), 4)], (rows, columns)), shape=(f + 1, f + 1))
    parent = breadth_first_order(graph, f, directed=False)[1]
    parent[f] = f
    own = np.arange(f)
    sign = np.r_[np.asarray((graph + graph.T)[own, parent[:f]]).ravel() - 3, 1]
    while (parent != f).any():  # every round doubles how far each triangle looks towards the root
        sign, parent = sign * sign[parent], parent[parent]
    return sign[:f].astype(np.int64)


def _inside(point: Array, body: Mesh, other: Mesh) -> bool:
    """Does `body`, one of whose vertices is `point`, lie in `other`? (winding number, van Oosterom and
    Strackee 1983)
    """
    corners, room = body.vertices[np.unique(body.faces)], other.vertices[np.unique(other.faces)]
    if (corners.min(axis=0) < room.min(axis=0)).any() or (corners.max(axis=0) > room.max(axis=0)).any():
        return False
    a, b, c = (other.vertices[other.faces[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    angle = np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb)
    return abs(float(angle.sum())) > np.pi
