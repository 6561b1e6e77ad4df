"""Triangles without height: their longest side is turned, so that every triangle has a plane."""

from __future__ import annotations

import numpy as np

from sed2cad.scan.scan import Array, Mesh
from sed2cad.topology.manifold import Faces, Index, following, half_edges, twins

_ROUNDS = 20


def without_caps(mesh: Mesh, height: float) -> Mesh:
    """The closed mesh with the longest side turned in triangles lower than `height`, over and over.

    A cap has a corner on its longest side (tessellations and repaired meshes have them). A side is turned where
    both new triangles are higher than the lower one was, or no lower and the new side is shorter (caps on caps),
    and where the new side is not there yet. The vertices stay, and so does the manifold.
    """
    faces = mesh.faces.copy()
    for _ in range(_ROUNDS):
        tall, longest = _heights(mesh.vertices, faces)
        low = np.flatnonzero(tall < height)
        sides = _turnable(mesh.vertices, faces, 3 * low + longest[low], height)
        if len(sides) == 0:
            break
        _turn(faces, sides)
    return Mesh(mesh.vertices, faces)


def _heights(vertices: Array, faces: Faces) -> tuple[Array, Index]:
    """The least height (f,) of triangles and which of their sides is the longest."""
    corners = vertices[faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    double = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return double / np.maximum(sides.max(axis=1), 1e-300), sides.argmax(axis=1)


def _turnable(vertices: Array, faces: Faces, sides: Index, height: float) -> Index:
    """Those of some half-edges that may be turned together: no triangle, and no new side, twice."""
    origin, target = half_edges(faces)
    twin = twins(faces)[sides]
    own, other = target[following(sides)], target[following(twin)]
    first = np.stack([own, origin[sides], other], axis=1)
    second = np.stack([other, target[sides], own], axis=1)
    pairs = (faces[sides // 3], faces[twin // 3]), (first, second)
    before, after = (np.minimum(*(_heights(vertices, t)[0] for t in pair)) for pair in pairs)
    before, after = (np.where(h < height, 0.0, h) for h in (before, after))
    old, new = (
        np.linalg.norm(vertices[a] - vertices[b], axis=1) for a, b in ((origin[sides], target[sides]), (own, other))
    )
    better = (after > before) | ((after == before) & (new < old))
    count = len(vertices)
    key = np.minimum(own, other) * count + np.maximum(own, other)
    there = np.isin(key, np.minimum(origin, target) * count + np.maximum(origin, target))
    good = np.flatnonzero(better & ~there & (own != other))
    good = good[np.unique(key[good], return_index=True)[1]]
    best = np.full(len(faces), np.inf)
    triangles = np.stack([sides // 3, twin // 3], axis=1)
    rank = np.empty(len(good))
    rank[np.argsort(before[good] - after[good], kind="stable")] = np.arange(len(good))
    np.minimum.at(best, triangles[good], rank[:, None])
    return np.asarray(sides[good[(best[triangles[good]] == rank[:, None]).all(axis=1)]])


def _turn(faces: Faces, sides: Index) -> None:
    """Turn half-edges in place; no two of them share a triangle."""
    origin, target = half_edges(faces)
    twin = twins(faces)[sides]
    own, other = target[following(sides)], target[following(twin)]
    faces[sides // 3], faces[twin // 3] = (
        np.stack([own, origin[sides], other], axis=1),
        np.stack([other, target[sides], own], axis=1),
    )
