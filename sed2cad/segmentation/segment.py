"""The stage: a scan and what the network says about it become patches with primitives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.network.predict import PointLabels
from sed2cad.network.types import BSPLINE
from sed2cad.primitives.base import Patch
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.energy import UNEXPLAINED, Tolerances
from sed2cad.segmentation.graph import Graph, neighbour_graph
from sed2cad.segmentation.mean_shift import mean_shift
from sed2cad.segmentation.refine import FEWEST, Refiner

Labels = NDArray[np.int64]

MOST_POINTS = 12_000  # the refinement sees so many; the others follow their neighbours
FLOOR = 3e-4  # unit frame: facets and rounding leave deviations of this size on a clean scan
EDGE = 0.75  # probability from which a point counts as an edge point


def segment(scan: Scan, labels: PointLabels | None, seed: int = 0) -> list[Patch]:
    """Patches of the scan: the network's clusters and smooth pieces, refined by the primitives they lead to."""
    seen = np.random.default_rng(seed).permutation(len(scan.points))[:MOST_POINTS]
    points, normals = scan.points[seen], scan.normals[seen]
    spacing = scan.spacing * np.sqrt(len(scan.points) / len(seen))
    tolerances = Tolerances(distance=max(FLOOR, scan.noise))
    graph = neighbour_graph(points, normals, spacing, tolerances.distance)
    proposals = [smooth_pieces(graph, weight) for weight in (0.85, 0.5)]
    if labels is not None:
        clusters = mean_shift(labels.descriptors[seen], seed=seed)
        i, j = graph.pairs.T
        proposals.append(_large(graph.components(clusters[i] == clusters[j])))
    freeform = labels.types[seen, BSPLINE].astype(float) if labels is not None else None
    state = Refiner(points, normals, graph, tolerances, freeform).run(proposals)
    everyone = _spread(scan, seen, state.labels, spacing)
    edge = labels.edge > EDGE if labels is not None else np.zeros(len(scan.points), bool)
    interior = _inside(scan, everyone) & ~edge
    return [
        Patch(members, choice.primitive.kind, interior[members])
        for k, choice in enumerate(state.primitives)
        if len(members := np.flatnonzero(everyone == k)) >= FEWEST
    ]


def smooth_pieces(graph: Graph, weight: float) -> Labels:
    """Region growing: connected pieces over pairs whose normals agree (weight above the given one)."""
    return _large(graph.components(graph.weights > weight))


def _large(labels: Labels) -> Labels:
    return np.where(np.bincount(labels)[labels] >= FEWEST, labels, UNEXPLAINED)


def _spread(scan: Scan, seen: NDArray[np.int64], labels: Labels, spacing: float) -> Labels:
    """Labels of all points: those that were not seen follow the nearest one that was, on their side of a wall."""
    if len(seen) == len(scan.points):
        out = np.empty(len(seen), np.int64)
        out[seen] = labels
        return out
    place = np.hstack([scan.points, 2 * spacing * scan.normals])
    return labels[cKDTree(place[seen]).query(place)[1]]


def _inside(scan: Scan, labels: Labels, k: int = 6) -> NDArray[np.bool_]:
    """Points whose nearest neighbours all lie on the same patch."""
    near = cKDTree(scan.points).query(scan.points, k=k)[1]
    return np.asarray((labels[near] == labels[:, None]).all(axis=1))
