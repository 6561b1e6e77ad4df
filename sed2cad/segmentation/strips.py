"""Narrow strips, one point wide: they hang together over gaps that the neighbour graph does not span."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.components import components

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

SURE = 3.0  # chance leaves a gap of SURE + log n mean distances in a strip of n points with probability exp(-SURE)
STRIP = 0.6  # spacings: a patch with less than one point per so much of its length is a strip
FARTHEST = 25.0  # spacings that a strip is followed across


def widest_gap(length: float, count: int) -> float:
    """What chance may leave between two of `count` points along a strip."""
    return (SURE + float(np.log(count))) * length / count


def bridged(points: Array, labels: Labels, pieces: Labels) -> Labels:
    """Pieces (n,) of one patch joined where the gap between them is one that chance leaves in a narrow strip."""
    pairs = []
    for members in groups(labels):
        own = pieces[members]
        if (own == own[0]).all():
            continue
        of_piece = groups(np.unique(own, return_inverse=True)[1])
        length = sum(extent(points[members[piece]]) for piece in of_piece)
        reach = widest_gap(length, len(members))
        pairs.append(members[cKDTree(points[members]).query_pairs(reach, output_type="ndarray")])
    if not pairs:
        return pieces
    return components(int(pieces.max()) + 1, pieces[np.concatenate(pairs)])[1][pieces]


def along_strips(
    points: Array, spacing: float, labels: Labels, explained: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which points (n, k) a narrow strip may claim beyond its neighbours: those that it explains (n, k), as far on as
    chance may leave two points of it apart."""
    claimed = np.zeros(explained.shape, bool)
    for column, members in enumerate(groups(labels)):
        length = extent(points[members])
        if length <= STRIP * spacing * len(members):
            continue
        held = np.flatnonzero(explained[:, column])
        gap = min(widest_gap(length, len(members)), FARTHEST * spacing)
        pairs = cKDTree(points[held]).query_pairs(gap, output_type="ndarray")
        piece = components(len(held), pairs)[1]
        own = np.unique(piece[np.isin(held, members)])
        claimed[held, column] = np.isin(piece, own)
    return claimed


def strip_pairs(points: Array, spacing: float, labels: Labels) -> NDArray[np.int64]:
    """Pairs (m, 2) of points of narrow strips, as near as chance may leave two points of one strip."""
    each, gap = np.zeros(len(labels)), np.zeros(len(labels))  # of its patch: length per point, and widest gap
    for members in groups(labels):
        length = extent(points[members])
        each[members], gap[members] = length / len(members), widest_gap(length, len(members))
    strips = np.flatnonzero(each > STRIP * spacing)
    if len(strips) < 2:
        return np.empty((0, 2), np.int64)
    pairs = strips[cKDTree(points[strips]).query_pairs(FARTHEST * spacing, output_type="ndarray")]
    i, j = pairs.T
    apart = np.linalg.norm(points[i] - points[j], axis=1)
    return pairs[apart < np.maximum(gap[i], gap[j])]


def extent(points: Array) -> float:
    """Diagonal of the box of points (n, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def groups(labels: Labels) -> list[NDArray[np.int64]]:
    """Members of each label from 0 up, in order; labels below 0 are left out."""
    order = np.argsort(labels, kind="stable")
    order = order[labels[order] >= 0]
    if not len(order):
        return []
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
