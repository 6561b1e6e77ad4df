"""The last word on the kinds, in units of the scan's noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.fitting import select
from sed2cad.segmentation.choose import plausible
from sed2cad.segmentation.energy import Tolerances
from sed2cad.segmentation.graph import Graph
from sed2cad.segmentation.level import Level
from sed2cad.segmentation.refine import State
from sed2cad.segmentation.strips import groups

Array = NDArray[np.float64]

ENOUGH = 12  # points that say more about the kind than the refinement knew
FREEFORM = 24  # points without which nothing is called freeform


def settle(level: Level, state: State, tolerances: Tolerances, noise: float) -> list[str]:
    """The kind of each patch, chosen again from its inner points.

    The refinement compares kinds within its tolerance, which is wider than the noise of a clean scan: there, a narrow
    cone passes for a sphere, and a piece of a freeform skin for a cylinder. The vertices of a mesh leave no doubt.
    """
    inner = _inner(level.graph, state.labels)
    kinds = []
    for members, choice in zip(groups(state.labels), state.primitives):
        if level.corners is not None and level.corners[members].settle(choice.primitive):
            kinds.append(choice.primitive.kind)
            continue
        few = members[inner[members]]
        few = few if len(few) >= ENOUGH else members
        found = None
        if len(few) >= ENOUGH:
            points, normals = level.points[few], level.normals[few]
            likely = [*plausible(points, normals, tolerances), "bspline"]
            found = select(points, normals, noise, likely)
        kind = choice.primitive.kind if found is None else found.primitive.kind
        kinds.append(choice.primitive.kind if kind == "bspline" and len(few) < FREEFORM else kind)
    return kinds


def _inner(graph: Graph, labels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Points (n,) all of whose neighbours have their label."""
    i, j = graph.pairs.T
    other = labels[i] != labels[j]
    out = np.ones(len(labels), bool)
    out[i[other]] = out[j[other]] = False
    return out
