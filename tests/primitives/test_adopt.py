"""A chamfer's short strip, fitted by a cone as flat as a washer about its own normal, gets the axis of the bore."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.primitives.adopt import adopt_axes
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.oriented_fit import directions
from sed2cad.primitives.proposals import DIRECTION, Piece, piece
from sed2cad.primitives.refine import refine
from sed2cad.primitives.relations import placement
from sed2cad.primitives.vectors import unit
from tests.primitives.patches import Z

NOISE, ANGLE = 0.003, 0.05


def flat_chamfer(seed: int, axis_tilt: float = 0.0) -> Piece:
    """20 degrees of a chamfer of 45 about Z (turned about y by `axis_tilt`), in the valley of a flat cone."""
    rng = np.random.default_rng(seed)
    angle, radius = np.radians(rng.uniform(-10, 10, 40)), rng.uniform(0.3, 0.32, (40, 1))
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    normals = (radial - Z) / np.sqrt(2)
    points = radius * (radial + Z) + NOISE * rng.uniform(-1.7, 1.7, (40, 1)) * normals
    normals = unit(normals + ANGLE * rng.normal(size=(40, 3)))
    cos, sin = np.cos(axis_tilt), np.sin(axis_tilt)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    points, normals = points @ turn.T, normals @ turn.T
    flat = Cone(-unit(normals.mean(axis=0)[None])[0], points.mean(axis=0), np.radians(87.0), 0.001)
    flat = refine(flat, points, NOISE, 40, directions=directions(flat, points, normals, NOISE, ANGLE))
    return piece(flat, points, normals, NOISE, ANGLE)


def bore() -> Piece:
    rng = np.random.default_rng(9)
    angle = rng.uniform(-np.pi, np.pi, 400)
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(400)])
    points = 0.25 * out + rng.uniform(0.0, 0.5, (400, 1)) * Z
    return piece(Cylinder(Z, np.zeros(3), 0.25), points, out, NOISE, ANGLE)


@pytest.mark.parametrize("seed", [0, 4])
def test_a_cone_in_another_valley_takes_the_axis_of_the_bore(seed: int) -> None:
    chamfer = flat_chamfer(seed)
    assert np.degrees(chamfer.spread(DIRECTION)) < 1.0  # it seems to be sure
    assert abs(placement(chamfer.primitive)[:3] @ Z) < np.cos(np.radians(30.0))
    pieces, hosts = adopt_axes({0: bore(), 1: chamfer})
    assert hosts == {1: 0}
    assert abs(placement(pieces[1].primitive)[:3] @ Z) == pytest.approx(1.0)
    assert placement(pieces[1].primitive)[6] == pytest.approx(np.pi / 4, abs=0.05)


@pytest.mark.parametrize("seed", [0, 4])
def test_it_does_not_where_its_points_are_about_another_axis(seed: int) -> None:
    _, hosts = adopt_axes({0: bore(), 1: flat_chamfer(seed, np.radians(40.0))})
    assert hosts == {}
