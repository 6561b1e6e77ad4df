"""Neighbours of every point at three scales, computed once per cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import softmax

from sed2cad.network.features import PAIR_NEIGHBOURS, Index

MAX_POINTS = 10_000
SCALES = (MAX_POINTS, 2_048, 256)
"""Scale s looks for neighbours among the first SCALES[s] points; the points come in random order."""
NEIGHBOURS = 16


@dataclass(frozen=True)
class Cloud:
    """One cloud in random order, in the unit frame."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3)
    neighbours: NDArray[np.uint16]  # (3, n, k), see neighbour_graph

    @property
    def pairs(self) -> Index:
        """(n, 10): the nearest others, each of which is a pair with the point."""
        return self.neighbours[0, :, 1 : PAIR_NEIGHBOURS + 1].astype(np.int64)


def neighbour_graph(points: NDArray, k: int = NEIGHBOURS) -> NDArray[np.uint16]:
    """(3, n, k): indices of the k nearest of the first SCALES[s] points, nearest first (itself included)."""
    return np.stack([cKDTree(points[:size]).query(points, k=k)[1].astype(np.uint16) for size in SCALES])


def coarse_weights(points: NDArray, normals: NDArray, neighbours: NDArray) -> NDArray[np.float32]:
    """(m, k), sum 1, of the coarse neighbours (m, k) of the first points: near ones with a like normal weigh most; the
    unit is the fourth distance."""
    rows = len(neighbours)
    gap = points[neighbours] - points[:rows, None]
    d2 = np.einsum("nkc,nkc->nk", gap, gap)
    cosine = np.einsum("nkc,nc->nk", normals[neighbours], normals[:rows])
    weights: NDArray[np.float32] = softmax(-d2 / (d2[:, 3:4] + 1e-9) - 4 * (1 - cosine), axis=1)
    return weights
