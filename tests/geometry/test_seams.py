"""Seams, poles and starts of closed edges."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.brep.attempt import Attempt
from sed2cad.brep.build import assemble
from sed2cad.errors import AssemblyError
from sed2cad.geometry.layout import Draft, Layout
from sed2cad.geometry.realise import realise
from sed2cad.geometry.seams import place
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from tests.geometry import parts

X, Y, Z = np.eye(3)


def layout(part: parts.Part) -> Layout:
    return place(Draft(realise(part.topology, part.fitted), part.fitted))


def test_all_coaxial_edges_start_on_one_seam() -> None:
    shaft = layout(parts.stepped_shaft())
    placement = shaft.faces[0].placement
    starts = np.array([shaft.vertices[edge.start] for edge in shaft.edges]) - placement.origin
    across = starts - (starts @ placement.z)[:, None] * placement.z
    assert across / np.linalg.norm(across, axis=1, keepdims=True) == pytest.approx(np.tile(placement.x, (4, 1)))


def test_a_partial_patch_keeps_its_seam_behind_it() -> None:
    part = layout(parts.filleted_box())
    fillet = next(f for f in part.faces if isinstance(f.primitive, Cylinder))
    middle = fillet.points.mean(axis=0) - fillet.placement.origin
    assert fillet.placement.x @ middle < 0


def test_closed_edges_have_one_vertex() -> None:
    edges = layout(parts.box_with_hole()).edges
    assert sorted(edge.start == edge.end for edge in edges) == [False] * 12 + [True] * 2
    assert all(edge.start >= 0 for edge in edges)


def test_the_pole_of_a_dome_is_its_top() -> None:
    dome = next(f for f in layout(parts.pill()).faces if isinstance(f.primitive, Sphere))
    assert abs(dome.placement.z @ Z) == pytest.approx(1)


def test_bends_start_on_the_outer_equator_and_pipes_follow() -> None:
    bend = layout(parts.pipe_bend())
    tube = bend.faces[0]
    for edge in bend.edges[:2]:
        start = bend.vertices[edge.start] - tube.placement.origin
        assert start @ tube.placement.z == pytest.approx(0, abs=1e-9)
        assert np.linalg.norm(start) == pytest.approx(25 / parts.pipe_bend().frame.scale)
    assert len(bend.edges) == 4  # nothing had to be cut


def test_the_seam_keeps_clear_of_the_edges_of_a_step() -> None:
    """They run along it: the kernel could not tell on which side of the seam they are."""
    part = stepped_end()
    placement = layout(part).faces[0].placement
    assert abs(placement.x @ X) > 0.1  # the edges are at +-Y
    made = assemble(Attempt(part.topology, part.fitted, part.frame, part.points))
    assert made.gate.passed and made.gate.volume == pytest.approx(part.volume, rel=1e-9)


def stepped_end(radius: float = 10.0, length: float = 20.0, step: float = 4.0) -> parts.Part:
    """A shaft one half of whose end is a step farther back."""
    b = parts.Builder()
    side, top = b.face(Cylinder(Z, np.zeros(3), radius)), b.face(Plane(Z, length))
    low, high, wall = b.face(Plane(-Z, 0.0)), b.face(Plane(-Z, -step)), b.face(Plane(-X, 0.0))
    p, q, p1, q1 = (b.corner(0, y, z) for z in (0, step) for y in (-radius, radius))
    t = np.linspace(-np.pi / 2, np.pi / 2, 30)
    half = radius * np.column_stack([np.cos(t), np.sin(t), np.zeros(30)])
    there, back = b.chain(half, side, low, p, q), b.chain(step * Z - half, side, high, q1, p1)
    up, down = b.line(q, q1, side, wall), b.line(p1, p, side, wall)
    foot, head = b.line(p, q, low, wall), b.line(p1, q1, wall, high)
    b.ring(parts.circle((0, 0, length), Z, radius), top, side)
    b.loop(side, (there, 1), (up, 1), (back, 1), (down, 1))
    b.loop(low, (there, -1), (foot, 1))
    b.loop(high, (back, -1), (head, -1))
    b.loop(wall, (foot, -1), (down, -1), (head, 1), (up, -1))
    volume = np.pi * radius**2 * (length - step / 2)
    return b.part(volume, 1.0)


def test_the_seam_keeps_clear_of_a_hole_in_the_wall() -> None:
    pipe = layout(parts.crossing_pipes())
    thick = pipe.faces[0]
    saddle = pipe.edges[3].arc.sampled(50) - thick.placement.origin
    along = saddle @ thick.placement.x
    aside = saddle @ np.cross(thick.placement.z, thick.placement.x)
    assert np.abs(np.arctan2(aside, along)).min() > 0.02


def test_a_winding_loop_of_several_edges_is_cut_where_the_seam_is() -> None:
    """Two half rings around a shaft whose corners do not lie above those of the other end."""
    b = parts.Builder()
    side = b.face(Cylinder(Z, np.zeros(3), 10.0))
    bottom, low, high = b.face(Plane(-Z, 0.0)), b.face(Plane(Z, 20.0)), b.face(Plane(Z, 20.0))
    b.ring(parts.circle((0, 0, 0), Z, 10.0), side, bottom)
    p, q = b.corner(10, 0, 20), b.corner(-10, 0, 20)
    half = np.linspace(0, np.pi, 30)
    there = b.chain(np.column_stack([10 * np.cos(half), 10 * np.sin(half), np.full(30, 20.0)]), low, side, p, q)
    back = b.chain(np.column_stack([-10 * np.cos(half), -10 * np.sin(half), np.full(30, 20.0)]), high, side, q, p)
    across = b.line(q, p, low, high)
    b.loop(low, (there, 1), (across, 1))
    b.loop(high, (back, 1), (across, -1))
    b.loop(side, (back, -1), (there, -1))
    found = layout(b.part(2000 * np.pi, 1.0))
    seam = found.faces[0].placement.x
    on_seam = [np.arctan2(np.cross(Z, seam) @ v, seam @ v) for v in found.vertices - found.faces[0].placement.origin]
    assert sum(abs(a) < 1e-6 for a in on_seam) == 2  # one on each ring


def test_an_open_cylinder_is_named() -> None:
    b = parts.Builder()
    side, bottom = b.face(Cylinder(Z, np.zeros(3), 10.0)), b.face(Plane(-Z, 0.0))
    b.ring(parts.circle((0, 0, 0), Z, 10.0), side, bottom)
    with pytest.raises(AssemblyError, match="cylinder face is open on one side"):
        layout(b.part(1.0, 1.0))
