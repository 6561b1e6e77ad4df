"""Regions, chains and corners: how the faces of the solid will hang together, without any mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """The common boundary of two regions: one edge of the solid.

    Walking along `points` with the outward normal up, `left` lies to the left. An open chain runs from corner
    `start` to corner `end` and its points include both ends; a closed chain has start = end = -1 and does not
    repeat its first point.
    """

    points: Array  # (k, 3), unit frame
    left: int  # region
    right: int  # region
    start: int  # corner or -1
    end: int  # corner or -1

    @property
    def closed(self) -> bool:
        return self.start < 0


@dataclass(frozen=True)
class Region:
    """One face of the solid: which primitive carries it and the loops around it.

    Each loop is a cycle of (chain, +1 | -1), walked with the region on the left and the outward normal up, so +1
    means that the region is the chain's `left`. A region without loops is a whole closed surface.
    """

    primitive: int  # index into the list of fitted patches
    loops: tuple[tuple[tuple[int, int], ...], ...]
    points: Array  # (m, 3) points spread over the region (for seams and centres), unit frame
    area: float  # of the region on the proxy mesh, unit frame
    body: int  # connected component of the proxy


@dataclass(frozen=True)
class Topology:
    """Every chain is shared by the two regions on its sides: closed by construction."""

    regions: tuple[Region, ...]
    chains: tuple[Chain, ...]
    corners: Array  # (c, 3), unit frame
    volume: float  # of the proxy mesh, unit frame
