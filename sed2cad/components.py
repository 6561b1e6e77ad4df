"""Connected components of pairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


def components(count: int, pairs: NDArray[np.int64]) -> tuple[int, NDArray[np.int64]]:
    """Connected components of `count` nodes under pairs (m, 2): how many, and which (count,) each is in."""
    ones = np.ones(len(pairs), dtype=np.int8)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, component = connected_components(graph, directed=False)
    return int(number), component.astype(np.int64)


def linked(points: NDArray[np.float64], reach: float) -> tuple[int, NDArray[np.int64]]:
    """Sets of points (n, 3) that hang together by steps up to `reach`: how many, and which (n,) each is in."""
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray").astype(np.int64)
    return components(len(points), pairs)
