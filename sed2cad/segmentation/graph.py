"""The neighbour graph that patches are connected on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import cKDTree

from sed2cad.components import components

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

CREASE = 0.25  # radians: normals of neighbours that differ by more have an edge between them
_FAR = 10.0  # unit frame: no two points of one part are so far apart
FACING = -0.5  # cosine of the normals below which two points lie on two sides of a wall


@dataclass(frozen=True)
class Graph:
    """Undirected: i and j are joined when either is among the other's k nearest and the normals do not oppose."""

    pairs: NDArray[np.int64]  # (m, 2), i < j, unique
    weights: Array  # (m,) how strongly two neighbours want the same patch, 0..1
    place: Array  # (n, 6 or 7) the space in which neighbours are near
    spacing: float  # of the points

    @property
    def size(self) -> int:
        return len(self.place)

    def adjacency(self, kept: NDArray[np.bool_] | None = None) -> csr_matrix:
        """Symmetric (n, n) matrix of the weights; of the pairs that `kept` (m,) says, or all."""
        chosen = slice(None) if kept is None else kept
        (i, j), weights = self.pairs[chosen].T, self.weights[chosen]
        both = coo_matrix((np.r_[weights, weights], (np.r_[i, j], np.r_[j, i])), shape=(self.size, self.size))
        return both.tocsr()

    def lengths(self, points: Array) -> Array:
        """How far apart (m,) the points of each pair are, of points (n, 3)."""
        return np.asarray(np.linalg.norm(points[self.pairs[:, 0]] - points[self.pairs[:, 1]], axis=1))

    def components(self, joined: NDArray[np.bool_]) -> Labels:
        """Connected components (n,) over the pairs that `joined` (m,) keeps."""
        return components(self.size, self.pairs[joined])[1]


def neighbour_graph(
    points: Array,
    normals: Array,
    spacing: float,
    tolerance: float,
    part: Labels | None = None,
    k: int = 10,
    turn: float = 8.0,
) -> Graph:
    """Join each point to its k nearest in (x, turn * spacing * n): a point of a narrow rim finds its neighbours along
    the rim, not on the large faces beside it.

    Pairs across a crease or a step higher than the tolerance get a small weight, opposed normals (the two sides of
    a thin wall) none at all, nor points of two parts (n,) if these are known.
    """
    place = np.hstack([points, turn * spacing * normals])
    if part is not None:
        place = np.column_stack([place, _FAR * part])
    near = cKDTree(place).query(place, k=k + 1, workers=-1)[1][:, 1:]
    i = np.repeat(np.arange(len(points)), near.shape[1])
    low, high = np.minimum(i, near.ravel()), np.maximum(i, near.ravel())
    pairs = np.column_stack(np.divmod(np.unique((low * len(points) + high)[low != high]), len(points)))
    cosine = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    kept = cosine > FACING if part is None else (cosine > FACING) & (part[pairs[:, 0]] == part[pairs[:, 1]])
    pairs, cosine = pairs[kept], cosine[kept]
    angle = np.arccos(np.clip(cosine, -1, 1))
    step = np.maximum(_step(points, normals, pairs, angle) - 2 * tolerance, 0) / (3 * tolerance)
    weights = 0.1 + 0.9 * np.exp(-0.5 * ((angle / CREASE) ** 2 + step**2))
    return Graph(pairs.astype(np.int64), weights, place, spacing)


def _step(points: Array, normals: Array, pairs: NDArray[np.int64], angle: Array) -> Array:
    """How far (m,) the points of a pair lie off each other's tangent planes, beyond what the turn of the normals over
    their distance explains (a circle's chord is half that turn off its tangent)."""
    way = points[pairs[:, 1]] - points[pairs[:, 0]]
    off = np.maximum(*(np.abs(np.einsum("ij,ij->i", way, normals[pairs[:, side]])) for side in (0, 1)))
    return off - np.linalg.norm(way, axis=1) * angle
