"""The network as a function: points and normals in, labels of every point out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.network.graph import MAX_POINTS, Cloud, neighbour_graph
from sed2cad.network.labeller import Labeller
from sed2cad.network.types import from_paper

NORMAL_WEIGHT = 0.03
"""A point takes the labels of the network's point next to it in (x, 0.03 n): on its side of a thin wall."""


@dataclass(frozen=True)
class PointLabels:
    """What the network says about the m points that it sees, of the n points of a scan."""

    seen: NDArray[np.int64]  # (m,) which points of the scan, in ascending order
    types: NDArray[np.float32]  # (m, 6) probabilities, in the order of PATCH_TYPES
    edge: NDArray[np.float32]  # (m,) probability to lie near an edge
    descriptors: NDArray[np.float32]  # (m, d), alike on one patch
    neighbours: NDArray[np.int64]  # (m, 10) nearest others among the points seen
    same: NDArray[np.float32]  # (m, 10) probability to lie on one patch with that neighbour; 0.5: no pair network
    nearest: NDArray[np.int64]  # (n,) whose labels a point of the scan takes: a row of the arrays above


def predict(points: NDArray, normals: NDArray, network: Labeller, seed: int = 0) -> PointLabels:
    """Label points (n, 3), n >= 50, in any frame and unit, with unit normals (n, 3).

    The network sees at most 10,000 of them in the frame it was trained in (box centred, longest side 1); the
    others take the labels of their nearest neighbour among those. The same seed gives the same labels.
    """
    order = np.random.default_rng(seed).permutation(len(points))[:MAX_POINTS]
    unit, normals = to_unit_frame(points), np.asarray(normals, np.float32)
    cloud = Cloud(unit[order], normals[order], neighbour_graph(unit[order]))
    said, same = network.label(cloud)
    rank = np.argsort(order)  # from the random order, which the graph needs, back to that of the scan
    seen, types = order[rank], said.types[rank]
    return PointLabels(
        seen,
        types if network.shape.torus else from_paper(types),
        said.edge[rank, 1],
        said.descriptors[rank],
        np.argsort(rank)[cloud.pairs][rank],
        same[rank],
        _nearest(unit, normals, seen),
    )


def _nearest(points: NDArray, normals: NDArray, seen: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row (n,) of `seen` next to each point in (x, NORMAL_WEIGHT n)."""
    if len(seen) == len(points):
        return np.arange(len(points))
    place = np.hstack([points, NORMAL_WEIGHT * normals])
    return cKDTree(place[seen]).query(place, workers=-1)[1]


def to_unit_frame(points: NDArray) -> NDArray[np.float32]:
    """Points moved and scaled so that their box is centred and its longest side is 1."""
    points = np.asarray(points, np.float64)
    low, high = points.min(0), points.max(0)
    return ((points - (low + high) / 2) / max((high - low).max(), 1e-300)).astype(np.float32)
