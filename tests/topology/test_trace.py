"""Topology of parts whose faces, edges and corners can be counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sed2cad.errors import AssemblyError
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.topology.manifold import euler_number, is_closed_manifold
from sed2cad.topology.model import Region, Topology
from sed2cad.topology.trace import Traced, trace

from . import scans

PARTS = {  # pieces, regions, chains, closed chains, corners, Euler number, volume
    "box": (scans.box(), 6, 12, 0, 8, 2, 0.14),
    "box with hole": (scans.box_with_hole(), 7, 14, 2, 8, 0, 0.14 - 0.4 * np.pi * 0.12**2),
    "stacked": (scans.stacked_cylinder(), 5, 4, 4, 0, 2, 0.3 * np.pi * (0.35**2 + 0.2**2)),
    "sphere": (scans.sphere(), 1, 0, 0, 0, 2, 4 / 3 * np.pi * 0.3**3),
    "torus": (scans.torus(), 1, 0, 0, 0, 0, 2 * np.pi**2 * 0.3 * 0.12**2),
}


def counts(topology: Topology) -> tuple[int, int, int, int]:
    closed = sum(chain.closed for chain in topology.chains)
    return len(topology.regions), len(topology.chains), closed, len(topology.corners)


def check_closed(topology: Topology) -> None:
    """Every chain is used once either way, by the regions it names, and every loop hangs together."""
    uses: dict[int, list[tuple[int, int]]] = {}
    for index, region in enumerate(topology.regions):
        for loop in region.loops:
            chains = [(topology.chains[chain], direction) for chain, direction in loop]
            ends = [(c.start, c.end) if direction > 0 else (c.end, c.start) for c, direction in chains]
            assert all(one[1] == other[0] for one, other in zip(ends, ends[1:] + ends[:1]))
            for chain, direction in loop:
                uses.setdefault(chain, []).append((direction, index))
    for index, chain in enumerate(topology.chains):
        assert sorted(uses[index]) == [(-1, chain.right), (1, chain.left)]


@pytest.mark.parametrize("name", PARTS)
def test_counts(name):
    pieces, regions, chains, closed, corners, euler, volume = PARTS[name]
    traced = trace(*scans.scan_of(pieces))
    topology = traced.topology
    assert counts(topology) == (regions, chains, closed, corners)
    check_closed(topology)
    assert is_closed_manifold(traced.proxy.faces)
    assert euler_number(traced.proxy.faces) == euler
    assert topology.volume == pytest.approx(volume, rel=0.02)
    if chains:  # V - E + F, a face with n loops counting as 2 - n
        faces = sum(2 - len(region.loops) for region in topology.regions)
        assert corners - (chains - closed) + faces == euler
    assert sorted(region.primitive for region in topology.regions) == list(range(regions))
    assert sum(region.area for region in topology.regions) == pytest.approx(
        sum(p[2] for p in pieces), rel=0.02
    )


@pytest.mark.parametrize("name", ["box", "box with hole"])
def test_counts_do_not_depend_on_the_frame(name):
    turn = Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
    traced = trace(*scans.scan_of(PARTS[name][0], turn=turn))
    assert counts(traced.topology) == PARTS[name][1:5]
    check_closed(traced.topology)


def test_left_region_is_on_the_left():
    topology = trace(*scans.scan_of(scans.box())).topology
    for chain in topology.chains:
        middle = len(chain.points) // 2
        along = chain.points[middle] - chain.points[middle - 1]
        up = topology.regions[chain.left].points.mean(axis=0)  # outward, for a box about the origin
        inwards = topology.regions[chain.left].points.mean(axis=0) - chain.points[middle]
        assert np.cross(up, along) @ inwards > 0


def test_chains_lie_on_the_edges():
    scan, fitted = scans.scan_of(scans.box())
    topology = trace(scan, fitted).topology
    for chain in topology.chains:
        for side in (chain.left, chain.right):
            primitive = fitted[topology.regions[side].primitive].primitive
            assert np.abs(primitive.distance(chain.points)).max() < 1.5 * scan.spacing


@pytest.mark.parametrize("thickness", [3.0, 1.5])
def test_a_thin_plate_stays_whole(thickness):
    plain, _ = scans.scan_of(scans.box((0.8, 0.5, 0.02)))
    size = (0.8, 0.5, thickness * plain.spacing)
    traced = trace(*scans.scan_of(scans.box(size)))
    assert counts(traced.topology) == (6, 12, 0, 8)
    assert euler_number(traced.proxy.faces) == 2
    assert traced.topology.volume == pytest.approx(np.prod(size), rel=0.05)


def test_a_narrow_chamfer_is_one_ring():
    ring, width = scans.ring, 0.012
    pieces = [
        ring(0.0, 0.3, -0.2, -1),
        scans.wall(0.3, -0.2, 0.2 - width),
        _chamfer(0.3, 0.2, width),
        ring(0.0, 0.3 - width, 0.2, 1),
    ]
    traced = trace(*scans.scan_of(pieces, 4000))
    assert counts(traced.topology) == (4, 3, 3, 0)


def _chamfer(radius: float, height: float, width: float) -> scans.Piece:
    """A cone of 45 degrees that cuts the rim of a cylinder around z."""
    from sed2cad.primitives.cone import Cone

    def points(rng: np.random.Generator, count: int) -> np.ndarray:
        angle, in_by = 2 * np.pi * rng.random(count), width * rng.random(count)
        across = radius - in_by
        down = height - width + in_by
        return np.column_stack([across * np.cos(angle), across * np.sin(angle), down])

    apex = np.array([0.0, 0.0, height - width + radius])
    return Cone(-scans.Z, apex, np.pi / 4), 1, 2 * np.pi * radius * width * np.sqrt(2), points


def test_a_missing_cap_is_added():
    scan, fitted = scans.scan_of(scans.stacked_cylinder())
    traced = trace(scan, fitted[:-1])
    assert counts(traced.topology) == (5, 4, 4, 0)
    cap = traced.fitted[-1].primitive
    assert len(traced.fitted) == 5 and cap.kind == "plane"
    assert cap.distance(np.array([[0.0, 0.0, 0.3]]))[0] == pytest.approx(0, abs=scan.spacing)


def test_nine_bores_with_floors_that_nobody_saw_are_closed():
    size, radius, floor = np.array([0.9, 0.9, 0.3]), 0.03, -0.02
    places = [np.array([x, y, 0.0]) for x in (-0.25, 0.0, 0.25) for y in (-0.25, 0.0, 0.25)]

    def bored(rng: np.random.Generator, count: int) -> np.ndarray:
        found = scans.rectangle(2, 1, size)[3](rng, 2 * count)
        away = np.min([np.linalg.norm((found - place)[:, :2], axis=1) for place in places], axis=0)
        return found[away > radius][:count]

    def bore(place: np.ndarray) -> scans.Piece:
        _, sign, area, points = scans.wall(radius, floor, size[2] / 2, -1)
        return Cylinder(scans.Z, place, radius), sign, area, lambda rng, count: points(rng, count) + place

    top = Plane(scans.Z, size[2] / 2), 1, float(size[0] * size[1]), bored
    scan, fitted = scans.scan_of([*scans.box(tuple(size))[:-1], top, *map(bore, places)], 9000)
    traced = trace(scan, fitted)
    caps = traced.fitted[len(fitted) :]
    assert len(caps) == len(places)
    for cap in caps:
        assert abs(cap.sign * cap.primitive.normal(np.zeros((1, 3)))[0, 2] - 1) < 1e-9
    levels = [-cap.primitive.distance(np.zeros((1, 3)))[0] for cap in caps]
    deepest = min(scan.points[patch.patch.indices, 2].min() for patch in fitted[6:])
    assert floor < deepest < floor + scan.spacing  # no wall ends above its points, and all floors are at one level
    assert levels == pytest.approx([deepest] * len(places), abs=1e-9)
    assert traced.caps == tuple(range(len(fitted), len(fitted) + len(places)))
    for place in places:
        around = [len(region.loops) for region in traced.topology.regions if on_bore(traced, region, place)]
        assert around == [2]


def on_bore(traced: Traced, region: Region, place: np.ndarray) -> bool:
    """Whether a region is on the bore at a place."""
    surface = traced.fitted[region.primitive].primitive
    return isinstance(surface, Cylinder) and bool(np.allclose(np.asarray(surface.point)[:2], place[:2]))


def test_a_closed_input_mesh_is_the_proxy():
    size = (0.7, 0.5, 0.4)
    scan, fitted = scans.scan_of(scans.box(size), 2000)
    traced = trace(replace(scan, mesh=scans.box_mesh(size)), fitted)
    assert traced.proxy.volume() == pytest.approx(0.14, rel=1e-6)
    assert counts(traced.topology) == (6, 12, 0, 8)


def test_nothing_fitted_is_an_error():
    scan, _ = scans.scan_of(scans.box(), 500)
    with pytest.raises(AssemblyError):
        trace(scan, [])
