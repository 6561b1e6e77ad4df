"""What planes cannot bound: a face with fewer than three planes around it and nothing else, and a ring between two.

Planes meet in lines. Such regions are what noise leaves of chips along edges, and of faces narrower than the triangles
of the proxy mesh; such rings are tunnels under an edge that the proxy mesh has there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sed2cad.geometry.web import Web
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.plane import Plane
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.labelling import Adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.model import Topology
from sed2cad.topology.regions import best_neighbour, connected, unpinch, weakest_apart
from sed2cad.topology.samples import Mask
from sed2cad.topology.walls import LEVEL, rise_at

_FEWEST = 3  # planes around a plane
_PASSES = 12
_OFF = 0.01  # unit frame: points that are nearer to the solid lie on it


def without_lenses(
    scan: Scan, fitted: Sequence[FittedPatch], mesh: Mesh, near: Adjacency, costs: Array, labels: Labels
) -> Labels:
    """Labels (f,) in which such regions have joined the best neighbour, the smallest first, where it is near."""
    flat = np.array([patch.primitive.kind == "plane" for patch in fitted])
    centres, (_, area) = mesh.centroids(), mesh.face_normals()
    limit = max(scan.reach, _OFF)
    for _ in range(_PASSES):
        number, region = connected(labels, near)
        lens = _impossible(scan, fitted, flat, centres, near, labels, region, number)
        chosen = weakest_apart(region, near, lens, np.bincount(region, area, number))
        before = labels
        for which in chosen:
            at = region == which
            best = best_neighbour(at, near, costs, before)
            if np.abs(fitted[best].primitive.distance(centres[at])).max() < limit:
                labels = np.where(at, best, labels)
        if labels is before:
            break
        labels = unpinch(mesh, costs, labels)
    return labels


def _impossible(
    scan: Scan,
    fitted: Sequence[FittedPatch],
    flat: Mask,
    centres: Array,
    near: Adjacency,
    labels: Labels,
    region: Labels,
    number: int,
) -> Mask:
    """Which regions (r,) are planes with too few planes around them, all at the same height along their border."""
    inner, outer = np.vstack([near.pairs, near.pairs[:, ::-1]]).T
    across = region[inner] != region[outer]
    inner, outer = inner[across], outer[across]
    around = np.unique(np.column_stack([region[inner], labels[outer]]), axis=0)
    name = np.zeros(number, dtype=np.int64)
    name[region] = labels
    lens = flat[name] & (np.bincount(around[:, 0], ~flat[around[:, 1]], number) == 0)
    lens &= np.isin(np.bincount(around[:, 0], minlength=number), range(1, _FEWEST))
    for which, other in around[lens[around[:, 0]]]:
        here = (region[inner] == which) & (labels[outer] == other)
        border = (centres[inner[here]] + centres[outer[here]]) / 2
        lens[which] &= rise_at(scan, fitted[name[which]], fitted[other], border) == 0
    return lens


def without_tunnels(topology: Topology, fitted: Sequence[FittedPatch]) -> Topology:
    """The topology with the holes closed that two planes share and nothing else goes through."""
    web = Web(topology)
    for number, chain in enumerate(topology.chains):
        beside = chain.left, chain.right
        left, right = (fitted[topology.regions[r].primitive].primitive for r in beside)
        if not (chain.closed and isinstance(left, Plane) and isinstance(right, Plane)):
            continue
        crossing = abs(left.normal_vector @ right.normal_vector) < LEVEL
        if crossing and all(len(topology.regions[r].loops) > 1 for r in beside):
            web = web.without_ring(number)
    return web.topology()
