"""Walls as thin as points lie apart are read from a part with thicker ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import Patch
from sed2cad.topology.manifold import euler_number
from sed2cad.topology.thicken import _moved_back, _thickened, has_thin_walls, traced_thick
from sed2cad.topology.trace import trace
from tests.topology import scans

CUP = [
    scans.ring(0.0, 0.3, -0.2, -1),
    scans.wall(0.3, -0.2, 0.2),
    scans.ring(0.292, 0.3, 0.2, 1),
    scans.wall(0.292, -0.192, 0.2, -1),
    scans.ring(0.0, 0.292, -0.192, 1),
]
VOLUME = np.pi * (0.3**2 * 0.4 - 0.292**2 * 0.392)


def test_a_thin_cup_keeps_its_wall() -> None:
    scan, fitted = scans.scan_of(CUP, 6000)
    assert 0.008 < 1.5 * scan.spacing
    assert has_thin_walls(scan)
    traced = traced_thick(scan, fitted, 1.0)
    assert sorted(region.primitive for region in traced.topology.regions) == [0, 1, 2, 3, 4]
    assert euler_number(traced.proxy.faces) == 2
    assert traced.topology.volume == pytest.approx(VOLUME, rel=0.1)


def test_a_block_has_no_thin_walls() -> None:
    scan, _ = scans.scan_of(scans.box(), 4000)
    assert not has_thin_walls(scan)


def test_there_and_back_is_where_it_was() -> None:
    """Vertices on faces, edges and corners of a box come back onto its surfaces."""
    by = 0.01
    scan, fitted = scans.scan_of(scans.box(), 3000)
    wide = trace(*_thickened(scan, fitted, by))
    names = np.array([region.primitive for region in wide.topology.regions])[wide.labels]
    assert wide.topology.volume == pytest.approx(0.72 * 0.52 * 0.42, rel=0.01)
    back = _moved_back(wide.proxy, names, wide.fitted, by)
    assert back.volume() == pytest.approx(0.7 * 0.5 * 0.4, rel=0.01)
    corners = np.unique(np.column_stack([wide.proxy.faces.ravel(), np.repeat(names, 3)]), axis=0)
    for label in range(6):
        at = corners[corners[:, 1] == label, 0]
        before = wide.fitted[label].primitive.distance(wide.proxy.vertices[at])
        after = fitted[label].primitive.distance(back.vertices[at])
        assert after == pytest.approx(before, abs=1e-9)


def test_what_has_no_parallel_surface_is_refused() -> None:
    scan, fitted = scans.scan_of(CUP, 3000)
    nothing = Patch(np.zeros(0, np.int64), "cylinder", np.zeros(0, bool))

    narrow = replace(fitted[3], patch=nothing, primitive=replace(fitted[3].primitive, radius=1e-4))
    with pytest.raises(AssemblyError, match="no parallel surface"):
        traced_thick(scan, [*fitted, narrow], 1.0)
