"""Neighbours of every point at three scales, computed once per cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

MAX_POINTS = 10_000
SCALES = (MAX_POINTS, 2_048, 256)
"""Scale s looks for neighbours among the first SCALES[s] points; the points come in random order."""
NEIGHBOURS = 16


def neighbour_graph(points: NDArray, k: int = NEIGHBOURS) -> NDArray[np.uint16]:
    """(3, n, k): indices of the k nearest of the first SCALES[s] points, nearest first (itself included)."""
    return np.stack([cKDTree(points[:size]).query(points, k=k)[1].astype(np.uint16) for size in SCALES])
