"""A cap is one piece of its face, and leaves one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.topology.caps import Cap, _in_one, levelled, tip_elsewhere, turns
from sed2cad.topology.labelling import adjacency
from sed2cad.topology.model import Chain, Region
from sed2cad.topology.trace import trace
from tests.topology import scans


def strip(columns: int, rows: int) -> tuple[Mesh, np.ndarray]:
    """A flat grid of triangle pairs, and the column and row (f, 2) of each triangle."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    cells = np.array([(i, j) for i in range(columns) for j in range(rows)])
    first = cells[:, 0] * (rows + 1) + cells[:, 1]
    lower = np.column_stack([first, first + rows + 1, first + rows + 2])
    upper = np.column_stack([first, first + rows + 2, first + 1])
    return Mesh(vertices, np.vstack([lower, upper])), np.vstack([cells, cells])


def test_specks_and_holes_are_evened_out() -> None:
    mesh, cells = strip(8, 10)
    inside = cells[:, 1] > 0  # the lowest row is another face
    beyond = cells[:, 1] > 6
    hole = (cells == (4, 8)).all(axis=1)
    speck = (cells == (2, 3)).all(axis=1)
    cap = _in_one(adjacency(mesh), inside, np.flatnonzero((beyond & ~hole) | speck))
    assert np.array_equal(cap, np.flatnonzero(beyond))


def cap_at(height: float, beyond: int, gap: float) -> Cap:
    """A level one, of the first triangles of a mesh."""
    nothing = Patch(np.zeros(0, np.int64), "plane", np.zeros(0, bool))
    plane = FittedPatch(nothing, Plane(np.array([0.0, 0, 1]), height), 1, 0.01, np.eye(3))
    return Cap(plane, np.arange(3), beyond, gap)


def test_floors_that_may_be_at_one_level_are_at_that_of_the_deepest() -> None:
    floors = [cap_at(0.1, -1, 0.02), cap_at(0.085, -1, 0.0), cap_at(0.2, -1, 0.02), cap_at(0.12, -1, 0.01)]
    tops = [cap_at(0.1, 1, 0.02), cap_at(0.11, 1, 0.0)]
    levels = [patch.primitive.distance(np.zeros((1, 3)))[0] for patch in levelled([*floors, *tops], strip(2, 2)[0])]
    assert levels == pytest.approx([-0.085, -0.085, -0.2, -0.12, -0.11, -0.11])
    assert levelled([], strip(2, 2)[0]) == []


def surface(primitive: Cylinder | Cone) -> FittedPatch:
    """The surface of a bore, without points."""
    nothing = Patch(np.zeros(0, np.int64), primitive.kind, np.zeros(0, bool))
    return FittedPatch(nothing, primitive, -1, 0.0, np.eye(primitive.freedom))


@pytest.mark.parametrize("end, found", [(0.11, True), (0.095, True), (0.14, False), (0.08, False)])
def test_a_bore_whose_end_nobody_saw_has_the_tip_of_its_like(end: float, found: bool) -> None:
    z, radius, half = np.array([0.0, 0, 1]), 0.1, np.radians(59)
    seen, unseen = Cylinder(z, np.zeros(3), radius), Cylinder(-z, np.array([1.0, 0, 5]), radius * 1.001)
    tip = Cone(z, np.array([0, 0, 0.1 - radius / np.tan(half)]), half)  # the seen bore ends at 0.1
    bores = [surface(seen), surface(tip), surface(unseen)]
    assert tip_elsewhere(bores[2], Plane(z, end), -1, 0.01, bores[::2]) is None
    other = surface(Cylinder(z, np.zeros(3), 1.5 * radius))
    assert tip_elsewhere(bores[2], Plane(z, end), -1, 0.01, [other, *bores[1:]]) is None
    like = tip_elsewhere(bores[2], Plane(z, end), -1, 0.01, bores)
    assert (like is not None) == found
    if like is not None:
        assert isinstance(like.primitive, Cone) and like.sign == -1
        assert like.primitive.apex == pytest.approx(tip.apex + np.array([1.0, 0, 0]))
        assert like.primitive.axis == pytest.approx(z) and like.primitive.half_angle == half


def test_a_fillet_is_not_open_however_its_border_jumps() -> None:
    surface = Cylinder(np.array([0.0, 0, 1]), np.zeros(3), 1.0)

    def at(angles: np.ndarray) -> np.ndarray:
        return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])

    border = Chain(at(np.array([0.0, 2, 4])), 0, 1, -1, -1)
    fillet, bore = (Region(0, (((0, 1),),), at(np.linspace(0, most, 20)), 1.0, 0) for most in (1.5, 6.2))
    assert turns(surface, fillet, [border]) == 0
    assert turns(surface, bore, [border]) == pytest.approx(1)


def drilled(points_of_tip: int) -> tuple[Scan, list[FittedPatch]]:
    """A box with a drill hole, of whose tip the scan shows a few points."""
    size, radius, floor = np.array([0.7, 0.5, 0.4]), 0.06, -0.05
    tip = Cone(np.array([0.0, 0, 1]), np.array([0.0, 0, floor - radius / np.sqrt(3)]), np.radians(60))

    def on_tip(rng: np.random.Generator, count: int) -> np.ndarray:
        angle, out = 2 * np.pi * rng.random(count), radius * np.sqrt(rng.random(count))
        return np.column_stack([out * np.cos(angle), out * np.sin(angle), tip.apex[2] + out / np.sqrt(3)])

    sides = [
        scans.rectangle(axis, side, size, radius if (axis, side) == (2, 1) else 0.0)
        for axis in range(3)
        for side in (-1, 1)
    ]
    scan, fitted = scans.scan_of([*sides, scans.wall(radius, floor, 0.2, -1), (tip, -1, 0.015, on_tip)], 8000)
    own = fitted[-1].patch.indices
    lost = own[points_of_tip:]
    fitted[-1] = replace(fitted[-1], patch=Patch(own[:points_of_tip], "cone", np.ones(points_of_tip, bool)))
    kept = np.setdiff1d(np.arange(len(scan.points)), lost)
    return replace(scan, points=scan.points[kept], normals=scan.normals[kept]), fitted


def test_a_drill_tip_with_few_points_closes_its_bore() -> None:
    scan, fitted = drilled(4)
    traced = trace(scan, fitted)
    assert len(traced.fitted) == len(fitted) and not traced.caps
    assert sorted(region.primitive for region in traced.topology.regions) == list(range(8))
    bore, tip = (next(r for r in traced.topology.regions if r.primitive == k) for k in (6, 7))
    assert [len(region.loops) for region in (bore, tip)] == [2, 1]
