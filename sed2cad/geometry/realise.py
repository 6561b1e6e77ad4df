"""From a traced topology to exact corners and edge curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.geometry.contact import Side
from sed2cad.geometry.curves import Array
from sed2cad.geometry.edges import EdgeGeometry, bent, edge_geometry
from sed2cad.geometry.meeting import meetings_of, sides_of
from sed2cad.geometry.merging import CornerClusters
from sed2cad.geometry.untangle import untangled
from sed2cad.primitives.base import FittedPatch
from sed2cad.topology.model import Topology


@dataclass(frozen=True)
class Realised:
    """The exact geometry of a topology, unit frame."""

    topology: Topology  # the given one with its impossible corners mended
    corners: Array  # (c, 3): where each corner went
    clusters: NDArray[np.int64]  # (c,): corners of the same number have become one
    corner_residuals: Array  # (c,): largest distance of each corner from its surfaces
    edges: tuple[EdgeGeometry | None, ...]  # one per chain; None where the chain was contracted to its corner


def realise(topology: Topology, fitted: Sequence[FittedPatch], bend: bool = False) -> Realised:
    """Move every corner onto all of its surfaces and every chain onto both of its own.

    With `bend` all edges end at their corners, even where that takes an exact curve off its surfaces.
    """
    sides = [Side.of(patch) for patch in fitted]
    topology = untangled(topology, sides, meetings_of(topology, sides))
    pairs = [sides_of(topology, sides, chain) for chain in topology.chains]
    meetings = meetings_of(topology, sides)
    clusters = CornerClusters(topology, sides, meetings)
    clusters.contract()
    labels = clusters.labels()
    corners = np.array([clusters.solved[c].position for c in labels]).reshape(-1, 3)
    edges = [
        edge_geometry(chain, a, b, how, corners) if alive else None
        for chain, (a, b), how, alive in zip(topology.chains, pairs, meetings, clusters.alive)
    ]
    if bend:
        edges = [
            edge and (edge if chain.closed else bent(edge, a, b, corners[chain.start], corners[chain.end]))
            for edge, chain, (a, b) in zip(edges, topology.chains, pairs)
        ]
    residuals = np.array([clusters.solved[c].residual for c in labels])
    return Realised(topology, corners, labels, residuals, tuple(edges))
