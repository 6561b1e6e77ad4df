"""Training samples: fresh points of a packed part, as some scanner would have measured them, each time anew."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.graph import MAX_POINTS, neighbour_graph
from sed2cad.network.predict import to_unit_frame
from sed2cad.network.types import paper_class
from sed2cad.scan.normals import tangents
from sed2cad.training.augment import (
    MAX_TURN,
    density,
    estimate_normals,
    flip_patch,
    missing_regions,
    noise,
    on_the_side_of,
    thin_out,
    turn,
)
from sed2cad.training.dataset import load_part
from sed2cad.training.labelled_part import LabelledCloud, LabelledPart

EDGE_DISTANCE = 7e-3
"""A point is an edge point when it lies this near to a true edge, longest side 1 (the paper, section 4)."""
MIN_POINTS = 3_000
"""Clouds of uneven density hold between this many and MAX_POINTS points, or fewer where fewer are asked for."""
SPARE = 1.8
"""Points drawn, in MAX_POINTS, where some are lost to missing regions and density."""
CLEAN = 0.5
"""Share of clean clouds."""


@dataclass(frozen=True)
class Faults:
    """What is wrong with a scan."""

    noise: bool = False
    estimated: bool = False  # the scan has no normals
    partial: bool = False
    uneven: bool = False

    @classmethod
    def draw(cls, rng: np.random.Generator, clean: float = CLEAN) -> Faults:
        """None with probability `clean`, else one to four of them, each about as often."""
        if rng.random() < clean:
            return cls()
        drawn = rng.random(4) < 0.4
        drawn[rng.integers(4)] = True
        return cls(*drawn.tolist())


@dataclass(frozen=True)
class Sample:
    """One cloud as the network sees it, n points in random order."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3)
    neighbours: NDArray[np.uint16]  # (3, n, k), see neighbour_graph
    patch: NDArray[np.int16]  # (n,)
    type: NDArray[np.int8]  # (n,) index into PATCH_TYPES
    paper_type: NDArray[np.int8]  # (n,) index into PAPER_TYPES
    edge: NDArray[np.bool_]  # (rows,) of the first points only


def load_sample(path: Path, key: Sequence[int], rows: int, clean: float = CLEAN, points: int = MAX_POINTS) -> Sample:
    """A sample of a packed part, the same each time for the same part and key (say, seed and epoch)."""
    rng = np.random.default_rng([zlib.crc32(path.stem.encode()), *key])
    return make_sample(load_part(path), Faults.draw(rng, clean), rng, rows, points)


def make_sample(
    part: LabelledPart, faults: Faults, rng: np.random.Generator, rows: int, count: int = MAX_POINTS
) -> Sample:
    """At most `count` fresh points with the given faults; `rows` of them are labelled for edges."""
    cloud, order = _measured(part, faults, rng, min(count, MAX_POINTS))
    exact, truth = cloud.points[order], cloud.normals[order]
    edge = part.edge_distance(exact[:rows]) < EDGE_DISTANCE
    points = noise(exact, truth, rng) if faults.noise else exact
    points = to_unit_frame(points) if faults.partial else points.astype(np.float32)
    near = neighbour_graph(points)
    patch = cloud.patch[order]
    if faults.estimated:
        normals = _estimated(points, truth, near[0], rng)
        normals = flip_patch(normals, patch, rng) if rng.random() < 0.15 else normals
    elif faults.noise:
        normals = turn(truth, MAX_TURN * rng.random(), rng)
    else:
        normals = truth if rng.random() < 0.5 else cloud.facet_normals[order]
    types = cloud.type[order]
    paper = paper_class(types, cloud.closed[order])
    return Sample(points, normals.astype(np.float32), near, patch, types, paper, edge)


def _measured(part: LabelledPart, faults: Faults, rng: np.random.Generator, most: int) -> tuple[LabelledCloud, NDArray]:
    """Exact points, and which of them, at most `most`, a scanner has measured, in random order."""
    if not (faults.partial or faults.uneven):
        return part.sample(rng, most, 0), np.arange(most)
    cloud = part.sample(rng, int(SPARE * MAX_POINTS), 0)
    seen = np.arange(len(cloud.points))
    if faults.partial:
        seen = np.flatnonzero(missing_regions(cloud.points, cloud.normals, rng))
    weight = density(cloud.points[seen], cloud.normals[seen], rng) if faults.uneven else np.ones(len(seen))
    count = int(rng.integers(MIN_POINTS, MAX_POINTS + 1)) if faults.uneven else MAX_POINTS
    return cloud, seen[thin_out(weight, min(count, most, len(seen)), rng)]


def _estimated(points: NDArray, truth: NDArray, near: NDArray, rng: np.random.Generator) -> NDArray:
    """Normals from the points alone: as the pipeline estimates them, or (much quicker) from 6 to 16 neighbours."""
    if rng.random() < 0.2:
        return on_the_side_of(tangents(points.astype(np.float64)).normals, truth)
    return estimate_normals(points.astype(np.float64), truth, near[:, : rng.integers(6, 17)])
