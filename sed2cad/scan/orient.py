"""Giving normals a consistent sign: outwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from sed2cad.scan.normals import Tangents
from sed2cad.scan.scan import Array

CONFIDENT = 0.1
"""Smoothed votes beyond this fix the sign of a normal; the others take it from their neighbours."""
ROUNDS = 4
"""Of smoothing the votes over the neighbours."""
SHEET = 0.15
"""Sine of the angle"""


def outward_signs(tangents: Tangents, votes: Array) -> Array:
    """Signs (n,) of 1 and -1 that turn the normals outwards.

    votes (n,): see outside.outward_votes. Confident votes decide; the rest follows along the minimum spanning tree
    of the neighbour graph (Hoppe et al. 1992), grown from all confident points at once. A part without any is turned
    as a whole.
    """
    points, normals, near = tangents.feet, tangents.normals, tangents.near
    for _ in range(ROUNDS):
        votes = _smoothed(votes, points, normals, near)
    fixed = np.abs(votes) > CONFIDENT
    i, j = _open_pairs(near, fixed)
    count, part = connected_components(csr_matrix((np.ones(len(i)), (i, j)), shape=(len(near), len(near))), False)
    loose = np.bincount(part, fixed, count) == 0  # parts without a confident point
    first = np.unique(part, return_index=True)[1]
    roots = np.r_[np.flatnonzero(fixed), first[loose]]
    own = np.where(votes < 0, -1.0, 1.0)
    signs = _along_tree(points, normals, own, i, j, roots)
    return signs * _part_signs(points, normals * signs[:, None], part, loose, cavity=fixed.mean() > 0.5)


def _smoothed(votes: Array, points: Array, normals: Array, near: NDArray) -> Array:
    """Mean votes over the neighbours, turned with the normals; across edges and from other sheets they count little."""
    total, count = votes.copy(), 1.0
    own = np.arange(len(votes))
    for j in near.T[1:]:
        agreement, same = _agreement(points, normals, own, j)
        weight = agreement**2*same
        total += np.sign(agreement) * weight * votes[j]
        count = count + weight
    return total / count


def _agreement(points: Array, normals: Array, i: NDArray, j: NDArray) -> tuple[Array, Array]:
    """Cosine (m,) between normal i mirrored over the midplane of i and j, and normal j; and how surely they lie on one sheet.

    Mirroring makes the cosine 1 for two points of one circle or of the two sides of an edge (Koenig and Gumhold
    2009), and -1 for points face to face.
    """
    way = points[j] - points[i]
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    up_i, up_j = np.einsum("ij,ij->i", normals[i], way), np.einsum("ij,ij->i", normals[j], way)
    cosine = np.einsum("ij,ij->i", normals[i], normals[j])
    mirrored = cosine - 2 * up_i * up_j
    return mirrored, np.exp(-(np.abs(up_i*up_j)) / (2 * SHEET**2))


def _open_pairs(near: NDArray, fixed: NDArray[np.bool_]) -> tuple[NDArray, NDArray]:
    """Neighbours (m,), (m,) of which at least one still needs a sign."""
    i, j = np.repeat(np.arange(len(near)), near.shape[1]), near.ravel()
    wanted = (i != j) & ~(fixed[i] & fixed[j])
    return i[wanted], j[wanted]


def _along_tree(points: Array, normals: Array, own: Array, i: NDArray, j: NDArray, roots: NDArray) -> Array:
    """Signs (n,) that follow from those of the roots along the tree of least turning over the pairs i, j."""
    n = len(normals)
    agreement, same = _agreement(points, normals, i, j)
    cost = 1 - np.abs(agreement) * same + 1e-6
    costs = np.r_[cost, np.full(len(roots), 1e-9)]
    ends = np.r_[i, np.full(len(roots), n)], np.r_[j, roots]
    tree = minimum_spanning_tree(csr_matrix((costs, ends), shape=(n + 1, n + 1)))
    parent = breadth_first_order(tree, n, directed=False)[1][:n]
    rooted = parent == n
    parent = np.where(rooted, np.arange(n), parent)
    signs = np.where(_agreement(points, normals, np.arange(n), parent)[0] < 0, -1.0, 1.0)
    signs[rooted] = own[rooted]
    ancestor = np.where(rooted, n, parent)
    signs, ancestor = np.r_[signs, 1.0], np.r_[ancestor, n]
    while (ancestor != n).any():  # every round doubles how far each point looks towards its root
        signs, ancestor = signs * signs[ancestor], ancestor[ancestor]
    return signs[:n]


def _part_signs(points: Array, normals: Array, part: NDArray, loose: NDArray[np.bool_], cavity: bool) -> Array:
    """Signs (n,): the flux through each loose part is made positive, or negative where it bounds a cavity."""
    count = len(loose)
    size = np.bincount(part, minlength=count)
    centre = np.column_stack([np.bincount(part, points[:, a], count) for a in range(3)]) / size[:, None]
    flux = np.bincount(part, np.einsum("ij,ij->i", points - centre[part], normals), count)
    turn = np.where(loose & ((flux < 0) != cavity), -1.0, 1.0)
    return turn[part]
