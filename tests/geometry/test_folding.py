"""Faces without width are left out, and their neighbours meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.brep.attempt import AssemblyResult, Attempt
from sed2cad.brep.build import assemble
from sed2cad.geometry.folding import fold
from sed2cad.geometry.layout import Draft
from sed2cad.geometry.realise import realise
from sed2cad.geometry.web import Web
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.vectors import unit
from sed2cad.topology.model import Chain, Region, Topology
from tests.geometry import parts
from tests.geometry.parts import X, Y, Z

NEW = 6  # number of the face that a box gets


def boxed(topology: Topology, normal: np.ndarray, point: np.ndarray) -> AssemblyResult:
    """The solid of a box with one more face, on a plane (unit frame)."""
    box = parts.box()
    extra = replace(box.fitted[0], primitive=Plane(normal, float(normal @ point)))
    return assemble(Attempt(topology, (*box.fitted, extra), box.frame, box.points))


def test_a_face_along_an_edge_is_none() -> None:
    """On a plane through the edge: both its edges are that edge."""
    box = parts.box()
    chain = box.topology.chains[0]  # between a wall and the bottom
    topology = Web(box.topology).doubled(0, chain.points, chain.points, between(chain.points)).topology()
    made = boxed(topology, unit(-Y - Z), chain.points[0])
    assert made.gate.passed and made.blamed == ()
    assert sorted(face.region for face in made.faces) == list(range(NEW))
    assert made.gate.volume == pytest.approx(box.volume, rel=1e-9)


def test_a_face_at_a_corner_is_none() -> None:
    """A mesh shows a triangle where the plane only touches the corner."""
    box = parts.box()
    topology = clipped(box.topology, 0)
    made = boxed(topology, unit(-X - Y - Z), box.topology.corners[0])
    assert made.gate.passed
    assert sorted(face.region for face in made.faces) == list(range(NEW))
    assert made.gate.volume == pytest.approx(box.volume, rel=1e-9)


@pytest.mark.parametrize("name", sorted(parts.EXACT))
def test_faces_with_width_stay(name: str) -> None:
    part: parts.Part = getattr(parts, name)()
    draft = Draft(realise(part.topology, part.fitted), part.fitted)
    before = [[list(loop) for loop in loops] for loops in draft.loops]
    fold(draft)
    assert draft.loops == before and not draft.gone


def between(points: np.ndarray) -> Region:
    """A region without loops yet."""
    return Region(NEW, (), points, 1e-4, 0)


def clipped(topology: Topology, corner: int, size: float = 0.004) -> Topology:
    """A corner cut off by a little triangle between its three chains."""
    web = Web(topology)
    turn = web.turn(corner)
    web.corners[corner] = topology.corners[corner] + size * unit(web.direction(turn[0][0]))
    places = [corner]
    for (k, end), _ in turn[1:]:
        chain = web.chains[k]
        places.append(len(web.corners))
        web.corners.append(topology.corners[corner] + size * unit(web.direction((k, end))))
        web.chains[k] = replace(chain, end=places[-1]) if end else replace(chain, start=places[-1])
    rim = []
    for n, (ray, region) in enumerate(turn):
        here, there = places[n], places[(n + 1) % len(turn)]
        rim.append(len(web.chains))
        points = np.linspace(web.corners[here], web.corners[there], 4)
        web.chains.append(Chain(points, region, NEW, here, there))
        arriving = (ray[0], 1 if ray[1] else -1)
        loop = next(loop for loop in web.loops[region] if arriving in loop)
        loop.insert(loop.index(arriving) + 1, (rim[-1], 1))
    triangle = between(np.array([web.corners[n] for n in places]))
    triangle = replace(triangle, loops=(tuple((k, -1) for k in rim[::-1]),))
    found = web.topology()
    return replace(found, regions=(*found.regions, triangle))
