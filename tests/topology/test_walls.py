"""A wall that the labels lost stands again, and the solid is exact."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sed2cad.brep.attempt import Attempt
from sed2cad.brep.build import assemble
from sed2cad.primitives.base import Patch
from sed2cad.topology.walls import walled
from tests.geometry import parts
from tests.geometry.parts import Builder, Plane, X, Y, Z
from tests.topology.test_trace import check_closed

LOW, HIGH, WIDE = 8.0, 10.0, 20.0


def stepped_box(bent: bool = False, slanted: float = 0.0) -> parts.Part:
    """A box of 30 x 20 whose top steps down from HIGH to LOW at x = 15, without the wall of the step.

    bent: the front turns at the step, too, so that four faces meet there. slanted: the step's border is askew.
    """
    b = Builder()
    front, right, back, left = (b.face(Plane(w, d)) for w, d in ((-Y, 0), (X, 30), (Y, WIDE), (-X, 0)))
    top, shelf, bottom = b.face(Plane(Z, HIGH)), b.face(Plane(Z, LOW)), b.face(Plane(-Z, 0))
    turned = front
    if bent:
        way = np.array([-3.0, -15.0, 0.0]) / np.hypot(3, 15)
        turned = b.face(Plane(way, float(way @ [15, 0, 0])))
    end = -3.0 if bent else 0.0
    middle = (LOW + HIGH) / 2
    floor = [b.corner(*p, 0.0) for p in ((0, 0), (15, 0), (30, end), (30, WIDE), (0, WIDE))]
    near, far = b.corner(15, 0, middle), b.corner(15 + slanted, WIDE, middle)
    roof = [b.corner(0, 0, HIGH), near, b.corner(30, end, LOW), b.corner(30, WIDE, LOW), far, b.corner(0, WIDE, HIGH)]
    rim = [b.line(roof[k], roof[(k + 1) % 6], [top, shelf, shelf, shelf, top, top][k],
                  [front, turned, right, back, back, left][k]) for k in range(6)]  # fmt: skip
    border = b.line(near, far, top, shelf)
    around = [front, turned, right, back, left]
    lows = [(b.line(floor[k], floor[(k + 1) % 5], around[k], bottom)) for k in range(5)]
    posts = [b.line(floor[f], roof[r], one, two) for f, r, one, two in (
        (0, 0, left, front), (2, 2, turned, right), (3, 3, right, back), (4, 5, back, left))]  # fmt: skip
    b.loop(top, (rim[0], 1), (border, 1), (rim[4], 1), (rim[5], 1))
    b.loop(shelf, (rim[1], 1), (rim[2], 1), (rim[3], 1), (border, -1))
    b.loop(bottom, *[(k, -1) for k in lows[::-1]])
    if bent:
        post = b.line(floor[1], near, front, turned)
        b.loop(front, (lows[0], 1), (post, 1), (rim[0], -1), (posts[0], -1))
        b.loop(turned, (lows[1], 1), (posts[1], 1), (rim[1], -1), (post, -1))
    else:
        b.loop(front, (lows[0], 1), (lows[1], 1), (posts[1], 1), (rim[1], -1), (rim[0], -1), (posts[0], -1))
    b.loop(right, (lows[2], 1), (posts[2], 1), (rim[2], -1), (posts[1], -1))
    b.loop(back, (lows[3], 1), (posts[3], 1), (rim[4], -1), (rim[3], -1), (posts[2], -1))
    b.loop(left, (lows[4], 1), (posts[0], 1), (rim[5], -1), (posts[3], -1))
    volume = 15 * WIDE * (LOW + HIGH) + (22.5 * LOW if bent else 0) + slanted * WIDE / 2 * (HIGH - LOW)
    return b.part(volume, 2000.0)


def sheet(thick: float = 1.0, wide: float = WIDE) -> parts.Part:
    """A plate of 30 x `wide` without its side at x = 0: there its top and bottom share a border."""
    b = Builder()
    front, right, back = (b.face(Plane(w, d)) for w, d in ((-Y, 0), (X, 30), (Y, wide)))
    top, bottom = b.face(Plane(Z, thick)), b.face(Plane(-Z, 0))
    low, high = ([b.corner(30, 0, z), b.corner(30, wide, z)] for z in (0.0, thick))
    near, far = b.corner(0, 0, thick / 2), b.corner(0, wide, thick / 2)
    lows = [b.line(near, low[0], front, bottom), b.line(low[0], low[1], right, bottom),
            b.line(low[1], far, back, bottom)]  # fmt: skip
    highs = [b.line(near, high[0], top, front), b.line(high[0], high[1], top, right), b.line(high[1], far, top, back)]
    posts = [b.line(low[0], high[0], front, right), b.line(low[1], high[1], right, back)]
    border = b.line(far, near, top, bottom)
    b.loop(top, *[(k, 1) for k in (*highs, border)])
    b.loop(bottom, *[(k, -1) for k in (border, *lows[::-1])])
    b.loop(front, (lows[0], 1), (posts[0], 1), (highs[0], -1))
    b.loop(right, (lows[1], 1), (posts[1], 1), (highs[1], -1), (posts[0], -1))
    b.loop(back, (lows[2], 1), (highs[2], -1), (posts[1], -1))
    return b.part(30 * wide * thick, 2000.0)


def raised_disc(radius: float = 5.0, height: float = 0.6) -> parts.Part:
    """A box of 30 x 20 x 10 with a low round boss, without the boss's side."""
    b = Builder()
    walls = [b.face(Plane(-Y, 0)), b.face(Plane(X, 30)), b.face(Plane(Y, 20)), b.face(Plane(-X, 0))]
    top, bottom, boss = b.face(Plane(Z, 10.0)), b.face(Plane(-Z, 0)), b.face(Plane(Z, 10 + height))
    parts.prism(b, [(0, 0), (30, 0), (30, 20), (0, 20)], 10.0, walls, top, bottom)
    b.ring(parts.circle((15, 10, 10 + height / 2), Z, radius), boss, top)
    return b.part(6000 + np.pi * radius**2 * height, 2000.0)


def scan_of(part: parts.Part, points: np.ndarray | None = None) -> SimpleNamespace:
    return SimpleNamespace(points=np.zeros((0, 3)) if points is None else points, spacing=0.02, noise=0.0)


@pytest.mark.parametrize(
    ("part", "kind"),
    [
        (stepped_box(), "plane"),
        (stepped_box(slanted=4.0), "plane"),
        (stepped_box(bent=True), "plane"),
        (raised_disc(), "cylinder"),
        (sheet(), "plane"),
        (sheet(thick=4.0, wide=5.0), "plane"),
    ],
    ids=["step", "slanted", "four faces", "boss", "sheet", "post"],
)
def test_a_step_gets_its_wall(part: parts.Part, kind: str) -> None:
    topology, patches = walled(scan_of(part), part.topology, part.fitted)
    check_closed(topology)
    assert len(topology.regions) == len(part.topology.regions) + 1
    assert [patch.primitive.kind for patch in patches[len(part.fitted) :]] == [kind]
    made = assemble(Attempt(topology, tuple(patches), part.frame, np.zeros((0, 3))))
    assert made.gate.passed, made.gate.reason
    assert made.gate.volume == pytest.approx(part.volume, rel=1e-6)
    assert made.exact


def test_without_its_wall_a_step_is_no_solid() -> None:
    part = stepped_box()
    made = assemble(Attempt(part.topology, part.fitted, part.frame, np.zeros((0, 3))))
    assert not made.gate.passed


def test_a_wall_takes_the_surface_that_runs_along_the_border() -> None:
    part = stepped_box()
    there = Plane(X, 15.0).scaled(1 / part.frame.scale, -part.frame.origin / part.frame.scale)
    points = part.frame.to_unit(np.array([[15.0, 3.0, 9.0], [15.0, 17.0, 9.2]]))
    patch = replace(part.fitted[0], primitive=there, patch=Patch(np.arange(2), "plane", np.ones(2, bool)))
    topology, patches = walled(scan_of(part, points), part.topology, [*part.fitted, patch])
    assert len(patches) == len(part.fitted) + 1
    assert topology.regions[-1].primitive == len(part.fitted)


def test_faces_at_one_height_and_low_steps_are_left_alone() -> None:
    for part in (parts.box(), parts.filleted_box(), parts.stepped_shaft(), parts.box_with_hole()):
        topology, patches = walled(scan_of(part), part.topology, part.fitted)
        assert topology is part.topology and len(patches) == len(part.fitted)
    low = raised_disc(height=0.1)  # 0.003 of the diagonal, a seventh of the spacing
    assert walled(scan_of(low), low.topology, low.fitted)[0] is low.topology
