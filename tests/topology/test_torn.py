"""A narrow ring that the labels tear is whole again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.topology.labelling import adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.torn import strips_closed
from sed2cad.topology.trace import trace
from tests.topology import scans

RING, LOW, HIGH = 2, 1, 3  # patches
INNER, OUTER = 0.32, 0.35  # radii


def step() -> list[scans.Piece]:
    """Two cylinders on each other with a narrow ring between."""
    low, middle, high = -0.3, 0.0, 0.3
    ends = scans.ring(0.0, OUTER, low, -1), scans.ring(0.0, INNER, high, 1)
    sides = scans.wall(OUTER, low, middle), scans.wall(INNER, middle, high)
    return [ends[0], sides[0], scans.ring(INNER, OUTER, middle, 1), sides[1], ends[1]]


def chamfered() -> list[scans.Piece]:
    """A cylinder with a chamfer below its upper end."""
    low, high = -0.3, 0.3
    edge = high - (OUTER - INNER)
    chamfer = scans.chamfer((OUTER, edge), (INNER, high))
    return [scans.ring(0.0, OUTER, low, -1), scans.wall(OUTER, low, edge), chamfer, scans.ring(0.0, INNER, high, 1)]


def labelled(pieces: list[scans.Piece], gap: float) -> tuple[Scan, list[FittedPatch], Mesh, Labels, Labels]:
    """A scan, its labels, and these with the ring's on some radians given to the faces on both sides."""
    scan, fitted = scans.scan_of(pieces, 6000)
    traced = trace(scan, fitted)
    true = np.array([region.primitive for region in traced.topology.regions])[traced.labels]
    x, y, _ = traced.proxy.centroids().T
    there = (true == RING) & (np.abs(np.arctan2(y, x)) < gap / 2)
    torn = np.where(there, np.where(np.hypot(x, y) > (INNER + OUTER) / 2, LOW, HIGH), true)
    return scan, fitted, traced.proxy, torn, true


def corners(labels: Labels, mesh: Mesh) -> int:
    """Vertices where three labels meet."""
    around = [np.unique(labels[(mesh.faces == vertex).any(axis=1)]) for vertex in range(len(mesh.vertices))]
    return sum(len(found) > 2 for found in around)


@pytest.mark.parametrize("part", [step, chamfered])
def test_a_torn_ring_is_closed(part: Callable[[], list[scans.Piece]]) -> None:
    scan, fitted, proxy, torn, true = labelled(part(), 0.07)
    assert corners(true, proxy) == 0 and corners(torn, proxy) == 2
    found = strips_closed(scan, fitted, proxy, adjacency(proxy), torn)
    assert corners(found, proxy) == 0
    assert (found == torn)[torn == RING].all()
    assert np.array_equal(strips_closed(scan, fitted, proxy, adjacency(proxy), true), true)


@pytest.mark.parametrize("part", [step, chamfered])
def test_a_gap_wider_than_chance_leaves_stays(part: Callable[[], list[scans.Piece]]) -> None:
    scan, fitted, proxy, torn, _ = labelled(part(), 2.0)
    assert corners(torn, proxy) >= 2
    assert np.array_equal(strips_closed(scan, fitted, proxy, adjacency(proxy), torn), torn)
