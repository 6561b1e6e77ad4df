"""A chamfer whose circle runs through the corners of its socket is a face for each side, not one around all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.brep.attempt import Attempt
from sed2cad.brep.build import assemble
from sed2cad.brep.kernel import from_bytes, volume
from sed2cad.geometry.necks import without_necks
from sed2cad.geometry.realise import realise
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from tests.geometry import parts
from tests.geometry.parts import PI, X, Y, Z, circle

HALF, DEPTH, RADIUS, HEIGHT = 5.0, 10.0, 20.0, 20.0
REACH = HALF * np.sqrt(2)


def socket(chamfer: float = REACH) -> parts.Part:
    """A cylinder with a square socket, chamfered with 45 degrees up to a radius; as a mesh shows it, the chamfer one
    face all the way around."""
    b = parts.Builder()
    ways = [-Y, X, Y, -X]
    side, bottom, top = b.face(Cylinder(Z, 0 * Z, RADIUS)), b.face(Plane(-Z, 0.0)), b.face(Plane(Z, HEIGHT))
    cone = b.face(Cone(Z, (HEIGHT - chamfer) * Z, PI / 4), -1)
    walls = [b.face(Plane(-way, -HALF)) for way in ways]
    floor = b.face(Plane(Z, HEIGHT - DEPTH))
    outline = [(-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF)]
    low = [b.corner(x, y, HEIGHT - DEPTH) for x, y in outline]
    high = [b.corner(x, y, HEIGHT - chamfer + REACH) for x, y in outline]
    lows = [b.line(low[k], low[(k + 1) % 4], floor, walls[k]) for k in range(4)]
    ups = [b.line(low[k], high[k], walls[k], walls[k - 1]) for k in range(4)]
    t, arcs = np.linspace(-HALF, HALF, 40), []
    for k in range(4):
        rise = HEIGHT - chamfer + np.hypot(HALF, t)
        points = HALF * ways[k] + np.outer(t, np.cross(Z, ways[k])) + np.outer(rise, Z)
        arcs.append(b.chain(points, walls[k], cone, high[k], high[(k + 1) % 4]))
    b.ring(circle((0, 0, 0), Z, RADIUS), side, bottom)
    b.ring(circle((0, 0, HEIGHT), Z, RADIUS), top, side)
    b.ring(circle((0, 0, HEIGHT), Z, chamfer), cone, top)
    b.loop(floor, *[(k, 1) for k in lows])
    b.loop(cone, *[(k, -1) for k in arcs[::-1]])
    for k in range(4):
        b.loop(walls[k], (ups[k], 1), (arcs[k], 1), (ups[(k + 1) % 4], -1), (lows[k], -1))
    over = np.sqrt(2) + np.log(1 + np.sqrt(2))
    cut = chamfer * (PI * chamfer**2 - 4 * HALF**2) - (2 * PI * chamfer**3 / 3 - 4 * HALF**3 * over / 3)
    solid = PI * RADIUS**2 * HEIGHT - 4 * HALF**2 * DEPTH - cut
    return b.part(solid, 1.0)


def test_a_face_without_width_at_corners_is_cut_there() -> None:
    part = socket()
    found = without_necks(part.topology, part.fitted)
    cones = [region for region in found.regions if region.primitive == 3]
    assert len(cones) == 4 and len(found.regions) == len(part.topology.regions) + 3
    assert all(len(region.loops) == 1 and len(region.loops[0]) == 2 for region in cones)
    assert all(len(region.points) for region in cones)
    realised = realise(found, part.fitted)
    assert all(edge is not None and edge.residual < 1e-5 for edge in realised.edges)


def test_its_solid_is_exact() -> None:
    part = socket()
    topology = without_necks(part.topology, part.fitted)
    made = assemble(Attempt(topology, part.fitted, part.frame, part.points))
    assert made.gate.valid and made.gate.closed and len(made.faces) == len(topology.regions)
    assert volume(from_bytes(made.brep)) == pytest.approx(part.volume, rel=1e-6)


@pytest.mark.parametrize("chamfer", [0.99 * REACH, 1.01 * REACH])
def test_noise_hides_whether_it_has_a_width(chamfer: float) -> None:
    """Too small, the circle would run through the walls of the socket."""
    part = socket(chamfer)
    noisy = [replace(patch, rms=2e-3) for patch in part.fitted]
    topology = without_necks(part.topology, noisy)
    assert len(topology.regions) == len(part.topology.regions) + 3
    made = assemble(Attempt(topology, tuple(noisy), part.frame, part.points))
    assert made.gate.valid and made.gate.closed
    assert volume(from_bytes(made.brep)) == pytest.approx(part.volume, rel=1e-3)


@pytest.mark.parametrize("chamfer", [1.02 * REACH, 1.3 * REACH])
def test_a_chamfer_that_goes_all_the_way_around_stays_one(chamfer: float) -> None:
    part = socket(chamfer)
    assert without_necks(part.topology, part.fitted).chains == part.topology.chains
