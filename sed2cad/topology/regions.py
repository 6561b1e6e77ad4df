"""Regions: connected triangles of one label, supported by points, in one sector at every vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.components import components
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.labelling import Adjacency
from sed2cad.topology.manifold import following, nearest_triangles, twins
from sed2cad.topology.mincut import Labels
from sed2cad.topology.samples import Mask

_LEAST_POINTS = 4
_LEAST_SHARE = 0.02  # of the points of its label
_LONG_BORDER = 3.0  # what a common border is worth against the data, per share of the whole border
_HOPELESS = 10.0  # cost of a triangle on a primitive that is no candidate
_PASSES = 12


@dataclass(frozen=True)
class Support:
    """Which triangle each labelled point is nearest to."""

    triangle: Labels  # (p,)
    label: Labels  # (p,)


def support_of(mesh: Mesh, scan: Scan, labels: Labels) -> Support:
    """The support that the labelled ones of the points (n,) give."""
    named = labels >= 0
    return Support(nearest_triangles(mesh, scan.points[named])[1], labels[named])


def connected(labels: Labels, near: Adjacency) -> tuple[int, Labels]:
    """Connected regions of one label: how many, and the region (f,) of each triangle."""
    same = labels[near.pairs[:, 0]] == labels[near.pairs[:, 1]]
    return components(len(labels), near.pairs[same])


def cleaned_labels(mesh: Mesh, near: Adjacency, costs: Array, labels: Labels, support: Support) -> Labels:
    """Labels (f,) without unsupported regions and without pinched vertices."""
    for _ in range(4):
        before = labels
        labels = merge_unsupported(near, costs, labels, support)
        labels = unpinch(mesh, costs, labels)
        if np.array_equal(labels, before):
            break
    return labels


def merge_unsupported(near: Adjacency, costs: Array, labels: Labels, support: Support) -> Labels:
    """Labels (f,) in which regions with too few points of their own have joined the best neighbour."""
    totals = np.bincount(support.label, minlength=costs.shape[1])
    for _ in range(_PASSES):
        number, region = connected(labels, near)
        name = np.zeros(number, dtype=np.int64)
        name[region] = labels
        held = region[support.triangle]
        points = np.bincount(held[name[held] == support.label], minlength=number)
        least = np.maximum(np.minimum(_LEAST_POINTS, 0.5 * totals[name]), _LEAST_SHARE * totals[name])
        weak = points < least
        chosen = weakest_apart(region, near, weak, points)
        if len(chosen) == 0 or number == 1:
            break
        labels = labels.copy()
        for which in chosen:
            at = region == which
            labels[at] = best_neighbour(at, near, costs, labels)
    return labels


def weakest_apart(region: Labels, near: Adjacency, weak: Mask, strength: NDArray) -> Labels:
    """The weak regions that have no weaker weak region beside them; strength (r,)."""
    sides = region[near.pairs]
    sides = sides[(sides[:, 0] != sides[:, 1]) & weak[sides].all(axis=1)]
    rank = np.empty(len(strength))
    rank[np.argsort(strength, kind="stable")] = np.arange(len(strength))
    beaten = np.where(rank[sides[:, 0]] > rank[sides[:, 1]], sides[:, 0], sides[:, 1])
    chosen = weak.copy()
    chosen[beaten] = False
    return np.flatnonzero(chosen)


def best_neighbour(inside: Mask, near: Adjacency, costs: Array, labels: Labels) -> int:
    """The neighbouring label on which the triangles `inside` (f,) cost least, long borders preferred."""
    border = inside[near.pairs[:, 0]] != inside[near.pairs[:, 1]]
    pairs, length = near.pairs[border], near.length[border]
    if len(pairs) == 0:
        return int(labels[inside][0])
    outer = labels[np.where(inside[pairs[:, 0]], pairs[:, 1], pairs[:, 0])]
    names, which = np.unique(outer, return_inverse=True)
    share = np.bincount(which, length) / length.sum()
    price = np.minimum(costs[np.ix_(inside, names)], _HOPELESS).mean(axis=0) - _LONG_BORDER * share
    return int(names[price.argmin()])


def unpinch(mesh: Mesh, costs: Array, labels: Labels, passes: int = 20) -> Labels:
    """Labels (f,) in which no label comes to a vertex in more than one sector."""
    twin = twins(mesh.faces)
    corner = np.arange(len(twin))
    turn = following(twin)  # the next corner around the same vertex
    labels = labels.copy()
    for _ in range(passes):
        own = labels[corner // 3]
        same = own == own[turn]
        number, sector = components(len(corner), np.column_stack([corner, turn])[same])
        vertex, name, size = np.zeros((3, number), dtype=np.int64)
        vertex[sector], name[sector] = mesh.faces.ravel(), own
        size = np.bincount(sector, minlength=number)
        order = np.lexsort((-size, name, vertex))
        again = (np.diff(vertex[order]) == 0) & (np.diff(name[order]) == 0)
        pinched = np.zeros(number, dtype=bool)
        pinched[order[1:][again]] = True
        if not pinched.any():
            break
        _flip(costs, labels, corner[pinched[sector]] // 3, mesh)
    return labels


def _flip(costs: Array, labels: Labels, triangles: Labels, mesh: Mesh) -> None:
    """Give the triangles (few) the cheapest other label among their neighbours, in place."""
    for triangle in np.unique(triangles):
        around = np.isin(mesh.faces, mesh.faces[triangle]).sum(axis=1) >= 2
        names = np.unique(labels[around])
        names = names[names != labels[triangle]]
        if len(names):
            price = np.minimum(costs[triangle, names], _HOPELESS)
            labels[triangle] = names[price.argmin()]
