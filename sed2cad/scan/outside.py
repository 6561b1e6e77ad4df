"""On which side of the surface is the outside? Votes from a grid of cells around the points.

Cells with points, and the cells around them, are walls. The others are outside when a flood from the border
reaches them, and they are seen from as many of the six axis directions as have no wall on the way. Walking
from a point along its normal and against it, the side that comes first to a cell that is more outside wins.
The flood reaches into bores; the sight helps where the scan has holes and the flood has leaked in.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from sed2cad.scan.scan import Array

CELL = 0.9
"""Side of a cell in units of the 90th percentile of the distance to the sixth neighbour."""
MOST_CELLS = 12_000_000
STEPS = np.arange(2, 8) / 2
"""Where cells are looked up on the way along the normal, in cells."""

LATER = 1.0
"""An open cell that much (in cells) farther away than a closed one on the other side lies behind another
wall."""


def outward_votes(points: Array, normals: Array, sixth: Array) -> Array:
    """Votes (n,) in -1 .. 1 that the normals (n, 3) of the points (n, 3) point outwards.

    sixth: the distances (n,) to the sixth neighbour. 0 where both sides look alike.
    """
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    coarsest = max((size.prod() / MOST_CELLS) ** (1 / 3), size.max() / 1000)
    side = max(CELL * float(np.quantile(sixth, 0.9)), coarsest)
    low = low - 8 * side
    shape = tuple(int(n) for n in np.ceil(size / side) + 16)
    openness = _openness(np.floor((points - low) / side).astype(np.int64), shape)
    start, step = (points - low) / side, normals
    (near, ahead), (far, behind) = _first_free(openness, start, step), _first_free(openness, start, -step)
    hidden = np.where(ahead > behind, near - far, far - near) > LATER
    return np.where(hidden, 0.0, ahead - behind)


def _openness(cells: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """How much outside each cell is, 0 .. 1, and -1 for walls; `cells` (n, 3) hold points."""
    wall = np.zeros(shape, dtype=bool)
    wall[tuple(cells.T)] = True
    for axis in range(3):
        line = np.moveaxis(wall, axis, 0)
        grown = line.copy()
        grown[1:] |= line[:-1]
        grown[:-1] |= line[1:]
        line[:] = grown
    parts, _ = label(~wall)
    openness = (parts == parts[0, 0, 0]).astype(np.float32) * 6
    for axis in range(3):
        line = np.moveaxis(wall, axis, 0)
        seen = np.moveaxis(openness, axis, 0)
        seen += ~np.logical_or.accumulate(line, axis=0)
        seen += ~np.logical_or.accumulate(line[::-1], axis=0)[::-1]
    openness /= 12
    openness[wall] = -1
    return openness


def _first_free(openness: NDArray[np.float32], start: Array, step: Array) -> tuple[Array, Array]:
    """How far (n,) in cells it is from start (n, 3) along step (n, 3) to a cell without wall, and its
    openness (n,).

    Openness fades with the length of the way, so that on a thin plate the near side wins.
    """
    way, found = np.full(len(start), STEPS[-1]), np.zeros(len(start))
    todo = np.arange(len(start))
    for t in STEPS:
        cell = np.floor(start[todo] + t * step[todo]).astype(np.int64)
        value = openness[tuple(cell.T)]
        free = value >= 0
        way[todo[free]] = t
        found[todo[free]] = value[free] * (1 - t / (2 * STEPS[-1]))
        todo = todo[~free]
    return way, found
