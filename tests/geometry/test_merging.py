"""Corners that become one, and corners that do not."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.realise import realise
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from tests.geometry.parts import PI, Builder, Part, Y


def notched(corners: list[tuple[float, float]], radius: float) -> Part:
    """A bar along y with a round notch from corner 2 to corner 3, 2 radii apart, and planes between the others."""
    b, depth = Builder(), 20.0
    front, back = b.face(Plane(-Y, 0.0)), b.face(Plane(Y, depth))
    points = [np.array([x, 0.0, z]) for x, z in corners]
    count = len(points)
    middle = (points[2] + points[3]) / 2
    along = (points[3] - points[2]) / 2
    angle = np.linspace(0, PI, 7)[:, None]
    arc = middle - np.cos(angle) * along + np.sin(angle) * np.cross(along, Y)
    sides = []
    for k, start in enumerate(points):
        if k == 2:
            sides.append(b.face(Cylinder(Y, middle, radius), -1))
            continue
        way = points[(k + 1) % count] - start
        normal = np.cross(way, Y) / -np.linalg.norm(way)
        sides.append(b.face(Plane(normal, float(normal @ start))))
    low = [b.corner(*p) for p in points]
    high = [b.corner(*(p + depth * Y)) for p in points]
    fronts = [
        b.chain(arc, front, sides[k], low[2], low[3])
        if k == 2
        else b.line(low[k], low[(k + 1) % count], front, sides[k])
        for k in range(count)
    ]
    backs = [
        b.chain(arc + depth * Y, sides[k], back, high[2], high[3])
        if k == 2
        else b.line(high[k], high[(k + 1) % count], sides[k], back)
        for k in range(count)
    ]
    ups = [b.line(low[k], high[k], sides[k], sides[k - 1]) for k in range(count)]
    b.loop(front, *[(k, 1) for k in fronts])
    b.loop(back, *[(k, -1) for k in backs[::-1]])
    for k in range(count):
        b.loop(sides[k], (ups[k], 1), (backs[k], 1), (ups[(k + 1) % count], -1), (fronts[k], -1))
    return b.part(1.0, 1.0)


def test_a_notch_between_two_faces_on_one_plane_stays_open() -> None:
    """The surfaces of its two corners all meet in both."""
    radius = 0.5
    part = notched([(0, 0), (30, 0), (30, 5 - radius), (30, 5 + radius), (30, 10), (0, 10)], radius)
    exact = realise(part.topology, part.fitted)
    assert all(edge is not None and edge.residual < 1e-9 for edge in exact.edges)
    for seed in range(10):
        noisy = realise(part.noisy(0.003, seed).topology, part.fitted)
        assert all(edge is not None and edge.residual < 1e-9 for edge in noisy.edges)
        assert np.abs(noisy.corners - exact.corners).max() < 1e-9
