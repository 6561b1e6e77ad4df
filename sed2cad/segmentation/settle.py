"""The last word on the kinds, in units of the scan's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.brep.beside import run_each
from sed2cad.fitting import select
from sed2cad.segmentation.choose import plausible
from sed2cad.segmentation.energy import Tolerances
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
    inner = _inner(level, state.labels)
    kinds: list[str | None] = []
    open_: list[_Question] = []
    for members, choice in zip(groups(state.labels), state.primitives):
        sure = level.corners is not None and level.corners[members].settle(choice.primitive)
        few = members[inner[members]]
        few = few if len(few) >= ENOUGH else members
        kinds.append(choice.primitive.kind if sure or len(few) < ENOUGH else None)
        if kinds[-1] is None:
            open_.append(_Question(level.points[few], level.normals[few], tolerances, noise, choice.primitive.kind))
    answers = iter(run_each(_kind, open_))
    return [kind or next(answers) for kind in kinds]


@dataclass(frozen=True)
class _Question:
    """Which kind points (n, 3) are of, and which it was taken for."""

    points: Array
    normals: Array
    tolerances: Tolerances
    noise: float
    before: str


def _kind(asked: _Question) -> str:
    """The kind that explains the points best, in units of the noise."""
    likely = [*plausible(asked.points, asked.normals, asked.tolerances), "bspline"]
    found = select(asked.points, asked.normals, asked.noise, likely)
    kind = asked.before if found is None else found.primitive.kind
    return asked.before if kind == "bspline" and len(asked.points) < FREEFORM else kind


def _inner(level: Level, labels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Points (n,) all of whose neighbours have their label, or all points as near as the rim is wide."""
    pairs = level.graph.pairs
    if level.rim:
        pairs = cKDTree(level.points).query_pairs(level.rim * level.graph.spacing, output_type="ndarray")
    i, j = pairs.T
    other = labels[i] != labels[j]
    out = np.ones(len(labels), bool)
    out[i[other]] = out[j[other]] = False
    return out
