"""Neighbour pairs to patches: average linkage, the second proposer beside mean shift."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from sed2cad.components import components
from sed2cad.network.predict import PointLabels

MARGIN = 0.3  # distance of two descriptors that speaks neither for nor against one patch
SCALE = 0.2  # further distance that changes the log odds by one
MOST = 6.0  # log odds beyond which a pair is as sure as it gets

Evidence = tuple[float, int]  # sum of the log odds of the pairs between two clusters, and their number


def pair_evidence(labels: PointLabels) -> NDArray[np.float64]:
    """Log odds (n, k) that a point and its neighbour lie on one patch: the pair network's, and what the distance of
    their descriptors adds."""
    same = np.clip(labels.same.astype(np.float64), 1e-6, 1 - 1e-6)
    gap = labels.descriptors[:, None] - labels.descriptors[labels.neighbours]
    apart = np.linalg.norm(gap, axis=2)
    return np.clip(np.log(same / (1 - same)) + (MARGIN - apart) / SCALE, -MOST, MOST)


def average_linkage(evidence: NDArray[np.float64], neighbours: NDArray[np.int64]) -> NDArray[np.int64]:
    """Clusters (n,) from evidence (n, k) about each point and its neighbours (n, k).

    Agglomerative clustering: the two clusters with the highest mean evidence between them become one, while that mean
    is above 0 (Sokal and Michener 1958, on the neighbour graph). Pairs that are quite sure join at once.
    """
    n, k = neighbours.shape
    i, j, e = np.repeat(np.arange(n), k), neighbours.ravel(), evidence.ravel()
    sure = e > MOST - 1
    count, first = components(n, np.column_stack([i, j])[sure])
    a, b = first[i], first[j]
    low, high = np.minimum(a, b)[a != b], np.maximum(a, b)[a != b]
    pairs, inverse, number = np.unique(low.astype(np.int64) * count + high, return_inverse=True, return_counts=True)
    total = np.bincount(inverse, e[a != b])
    joined = _merge(count, (pairs // count).tolist(), (pairs % count).tolist(), total.tolist(), number.tolist())
    return np.unique(joined[first], return_inverse=True)[1]


def _merge(count: int, a: list[int], b: list[int], total: list[float], number: list[int]) -> NDArray[np.int64]:
    """Join clusters 0..count-1, best mean first; the cluster (count,) that each has become a part of."""
    around: list[dict[int, Evidence]] = [{} for _ in range(count)]
    for x, y, t, m in zip(a, b, total, number):
        around[x][y] = around[y][x] = (t, m)
    heap = [(-t / m, x, y) for x, y, t, m in zip(a, b, total, number) if t > 0]
    heapq.heapify(heap)
    owner = np.arange(count)
    while heap:
        mean, x, y = heapq.heappop(heap)
        sum_, pairs = around[x].get(y, (0.0, 1))
        if -sum_ / pairs != mean:  # one of the two has changed since
            continue
        x, y = (y, x) if len(around[x]) < len(around[y]) else (x, y)
        owner[y] = x
        del around[x][y]
        for z, (t, m) in around[y].items():
            if z == x:
                continue
            del around[z][y]
            before = around[x].get(z, (0.0, 0))
            between = (before[0] + t, before[1] + m)
            around[x][z] = around[z][x] = between
            if between[0] > 0:
                heapq.heappush(heap, (-between[0] / between[1], x, z))
        around[y] = {}
    while (owner[owner] != owner).any():
        owner = owner[owner]
    return owner
