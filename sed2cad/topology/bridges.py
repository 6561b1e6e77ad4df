"""Narrow faces that a proxy mesh tears apart: where its triangles are wider than a strip, the faces on both sides meet
over it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.segmentation.strips import extent, widest_gap
from sed2cad.topology.labelling import Adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.regions import connected
from sed2cad.topology.samples import Mask

_ON = 0.5  # spacings: the way over a gap stays so near to the surface


def bridged_labels(scan: Scan, fitted: Sequence[FittedPatch], mesh: Mesh, near: Adjacency, labels: Labels) -> Labels:
    """Labels (f,) in which the regions of a patch hang together over gaps that chance leaves between its points."""
    labels = labels.copy()
    ways = _ways(mesh, near)
    number, region = connected(labels, near)
    name = np.zeros(number, dtype=np.int64)
    name[region] = labels
    for label in np.flatnonzero(np.bincount(name, minlength=len(fitted)) > 1).tolist():
        patch = fitted[label]
        points = scan.points[patch.patch.indices]
        if len(points) == 0:
            continue
        gap = widest_gap(extent(points), len(points))
        on = np.abs(patch.primitive.distance(mesh.centroids())) < _ON * scan.spacing
        _bridge(labels, label, on, ways, near, gap)
    return labels


def _bridge(labels: Labels, label: int, on: Mask, ways: csr_array, near: Adjacency, gap: float) -> None:
    """Give `label` the shortest ways over the triangles `on` (f,) its surface between its regions, in place."""
    while True:
        own = labels == label
        _, region = connected(labels, near)
        pieces = np.unique(region[own])
        open_ = np.flatnonzero(on | own)
        place = np.full(len(labels), -1)
        place[open_] = np.arange(len(open_))
        graph = ways[open_][:, open_]
        found: list[tuple[float, Labels]] = []
        for piece in pieces[:-1]:
            start = place[np.flatnonzero(own & (region == piece))]
            far, before, _ = dijkstra(graph, indices=start, min_only=True, limit=gap, return_predecessors=True)
            others = place[np.flatnonzero(own & (region > piece))]
            end = int(others[np.argmin(far[others])])
            if np.isfinite(far[end]):
                found.append((float(far[end]), open_[_back(before, end)]))
        if not found:
            return
        labels[min(found, key=lambda entry: entry[0])[1]] = label


def _back(before: Labels, end: int) -> Labels:
    """The way back from `end` to where a search began."""
    path = [end]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return np.array(path)


def _ways(mesh: Mesh, near: Adjacency) -> csr_array:
    """How far (f, f) it is from the middle of one triangle to that of the next."""
    centres: Array = mesh.centroids()
    i, j = near.pairs.T
    far = np.maximum(np.linalg.norm(centres[i] - centres[j], axis=1), 1e-12)
    shape = (len(centres), len(centres))
    return coo_array((np.r_[far, far], (np.r_[i, j], np.r_[j, i])), shape=shape).tocsr()
