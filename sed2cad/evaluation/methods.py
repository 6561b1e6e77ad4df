"""The ways to segment a scan that are compared: network alone, refined, region growing.

CGAL's Efficient RANSAC (Schnabel et al. 2007) is not among them: CGAL's shape detection is GPL, and no kept,
permissively licensed package on PyPI offers it (pyransac3d fits one primitive at a time).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.network.predict import PointLabels
from sed2cad.network.types import PATCH_TYPES
from sed2cad.primitives.base import Patch
from sed2cad.scan.scan import Array, Scan
from sed2cad.segmentation.linkage import average_linkage, pair_evidence
from sed2cad.segmentation.mean_shift import absorb_small
from sed2cad.segmentation.segment import EDGE, segment

NETWORK, REFINED, GROWING = METHODS = ("network", "refined", "growing")
"""Its pairs linked; the pipeline's `segment` with the network; region growing on normals."""
NEED_NETWORK = (NETWORK, REFINED)
"""These also tell types."""
NEIGHBOURS = 10
CRUMBS = 6
"""The network alone proposes no patch of fewer points."""
GROWING_ANGLE = 10.0
"""Degrees between the normals of neighbours up to which a region grows."""
SHARP = 0.3
"""Sine of the angle between two normals from which on their tangent planes locate the edge between them."""
OPPOSED = -0.9
"""Cosine between normals below which two points lie on two sides of a wall, with no edge between them."""


@dataclass(frozen=True)
class Labelling:
    """What a method says about each of n points."""

    patch: NDArray[np.int64]  # (n,) -1: none
    type: NDArray[np.int64] | None  # (n,) index into PATCH_TYPES, -1: none; None: the method tells no types
    edge: NDArray[np.bool_]  # (n,) near an edge
    seconds: float = 0.0

    @classmethod
    def nothing(cls, count: int) -> Labelling:
        """No label for any of `count` points: what a method that fails has said."""
        none = np.full(count, -1)
        return cls(none, none, np.zeros(count, bool))


def run_method(method: str, scan: Scan, labels: PointLabels | None, edge_distance: float, seed: int = 0) -> Labelling:
    """Segment the scan's points by one of METHODS; `labels` of the network for those that need it.

    `edge_distance`: how near to an edge, unit frame, an edge point lies.
    """
    start = time.perf_counter()
    if method == GROWING or labels is None:
        patch = grow_regions(scan.points, scan.normals)
        type_, edge = None, None
    elif method == NETWORK:
        patch = propose_patches(labels)[labels.nearest]
        type_, edge = labels.types.argmax(axis=1)[labels.nearest], labels.edge[labels.nearest] > EDGE
    else:
        patch, type_ = labels_of(segment(scan, labels, seed).patches, len(scan.points))
        edge = None
    seconds = time.perf_counter() - start
    if edge is None:
        edge = near_boundaries(scan.points, scan.normals, patch, edge_distance)
    return Labelling(patch, type_, edge, seconds)


def propose_patches(labels: PointLabels) -> NDArray[np.int64]:
    """Patches (m,) of the points that the network sees, from what it says alone: average linkage, no crumbs."""
    linked = average_linkage(pair_evidence(labels), labels.neighbours)
    return absorb_small(linked, labels.neighbours, CRUMBS)


def grow_regions(points: Array, normals: Array, degrees: float = GROWING_ANGLE) -> NDArray[np.int64]:
    """Patches (n,): connected pieces over neighbours whose normals (n, 3) agree, no crumbs.

    Region growing (Rabbani et al. 2006) without its order: what can be reached is the same.
    """
    near = _neighbours(points)
    i, j = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    agree = np.einsum("ij,ij->i", normals[i], normals[j]) > np.cos(np.radians(degrees))
    return absorb_small(components(len(points), np.column_stack([i, j])[agree])[1], near)


def labels_of(patches: list[Patch], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Patch and type (count,) of each point, -1 where no patch holds it."""
    patch, type_ = np.full(count, -1), np.full(count, -1)
    for index, found in enumerate(patches):
        patch[found.indices] = index
        type_[found.indices] = PATCH_TYPES.index(found.kind)
    return patch, type_


def near_boundaries(points: Array, normals: Array, patch: NDArray[np.int64], distance: float) -> NDArray[np.bool_]:
    """Points (n,) within `distance` of a boundary between two patches.

    The boundary is finer than the points are dense. Between two neighbours of different patches it is where
    their tangent planes meet, in the tangent plane of each |dx . n'| / sin(n, n') away; where the normals
    nearly agree, it is half-way.
    """
    near = _neighbours(points)
    i, j = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    across = (patch[i] != patch[j]) & (patch[i] >= 0) & (patch[j] >= 0)
    i, j = i[across], j[across]
    way = points[j] - points[i]
    length = np.linalg.norm(way, axis=1)
    sine = np.linalg.norm(np.cross(normals[i], normals[j]), axis=1)
    met = np.abs(np.einsum("ij,ij->i", way, normals[j])) / np.maximum(sine, SHARP)
    gap = np.where(sine > SHARP, np.minimum(met, length), length / 2)
    cosine = np.einsum("ij,ij->i", normals[i], normals[j])
    out = np.zeros(len(points), bool)
    out[i[(gap <= distance) & (cosine > OPPOSED)]] = True
    return out


def _neighbours(points: Array) -> NDArray[np.int64]:
    """(n, NEIGHBOURS) nearest other points."""
    return cKDTree(points).query(points, k=NEIGHBOURS + 1)[1][:, 1:]
