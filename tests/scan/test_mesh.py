"""Meshes: welding, winding, sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.errors import ScanError
from sed2cad.scan.mesh import is_closed, is_measured, smooth_edges, smooth_fans, smooth_parts, weld, wound_outwards
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.sample import sample_mesh
from sed2cad.scan.scan import Mesh
from tests.segmentation.shapes import extruded

CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE = Mesh(CORNERS, np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]))


def tube(n: int) -> Mesh:
    """A prism with n sides of radius 1 and height 1: a tessellated cylinder with flat ends."""
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.vstack([np.c_[ring, np.zeros(n)], np.c_[ring, np.ones(n)], [[0, 0, 0], [0, 0, 1]]])
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    low, high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = [(i, j, n + j), (i, n + j, n + i), (j, i, low), (n + i, n + j, high)]
    return Mesh(vertices, np.vstack([np.column_stack(f) for f in faces]))


def soup(mesh: Mesh) -> Mesh:
    """Every triangle with corners of its own."""
    return Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))


def scaled(mesh: Mesh, scale: float) -> Mesh:
    return replace(mesh, vertices=scale * mesh.vertices)


def together(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes])
    return Mesh(np.vstack([m.vertices for m in meshes]),
                np.vstack([m.faces + s for m, s in zip(meshes, starts)]))


@pytest.mark.parametrize("jitter", [0.0, 1e-6])
def test_weld(jitter: float) -> None:
    loose = soup(tube(24))
    vertices = loose.vertices + np.random.default_rng(0).uniform(-jitter, jitter, loose.vertices.shape)
    mesh = weld(Mesh(vertices, np.vstack([loose.faces, loose.faces[:5], loose.faces[:4, [0, 0, 1]]])))
    assert is_closed(mesh)
    assert len(mesh.vertices) == 50 and len(mesh.faces) == 96
    assert mesh.volume() == pytest.approx(tube(24).volume(), rel=1e-4)


def test_an_open_mesh_stays_open() -> None:
    mesh = weld(Mesh(CUBE.vertices, CUBE.faces[2:]))
    assert not is_closed(mesh) and len(mesh.faces) == 10


def test_winding() -> None:
    faces = tube(24).faces.copy()
    faces[np.random.default_rng(0).random(len(faces)) < 0.4] = 0
    turned = np.where(faces.any(axis=1)[:, None], tube(24).faces, tube(24).faces[:, ::-1])
    for mesh in (Mesh(tube(24).vertices, turned), replace(tube(24), faces=tube(24).faces[:, ::-1])):
        assert wound_outwards(mesh).volume() == pytest.approx(tube(24).volume())


def test_a_cavity_is_wound_inwards_and_a_body_in_it_outwards() -> None:
    nested = together(scaled(CUBE, 3), scaled(CUBE, 2), CUBE)
    assert wound_outwards(nested).volume() == pytest.approx(8 * (27 - 8 + 1))


def test_smooth_parts() -> None:
    assert smooth_parts(CUBE, smooth_edges(CUBE, 30))[0] == 6
    assert smooth_parts(tube(24), smooth_edges(tube(24), 30))[0] == 3


def test_samples_are_even_and_on_the_mesh() -> None:
    on = sample_mesh(CUBE, 0, 6000)
    points, normals = on.points, on.normals
    assert len(points) == pytest.approx(6000, abs=2)
    np.testing.assert_allclose(np.abs(points).max(axis=1), 1)
    np.testing.assert_allclose(np.einsum("ij,ij->i", points, normals), 1)
    assert np.histogram2d(*points[normals[:, 2] > 0.5, :2].T, bins=4)[0].std() < 15


def test_round_normals_on_a_tessellated_cylinder() -> None:
    on = sample_mesh(tube(36), 0, 4000)
    points, normals = on.points, on.normals
    side = np.abs(normals[:, 2]) < 0.5
    radial = points[side, :2] / np.linalg.norm(points[side, :2], axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normals[side, :2], radial)
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).max() < 1  # facets alone: 5 degrees
    assert np.all(np.abs(normals[~side, 2]) == pytest.approx(1))


@pytest.mark.parametrize("n", [24, 48])
def test_points_of_a_tessellated_cylinder_lie_on_the_round_one(n: int) -> None:
    """What the chords cut off is put back to second order: the rest falls with the fourth power of the angle."""
    on = sample_mesh(tube(n), 0, 4000)
    points, normals = on.points, on.normals
    side = np.abs(normals[:, 2]) < 0.5
    off = np.abs(np.linalg.norm(points[side, :2], axis=1) - 1).max()
    half = np.pi / n
    assert off < 0.5 * half**4 < 0.02 * (1 - np.cos(half))


def test_small_faces_get_points() -> None:
    small = replace(scaled(CUBE, 0.02), vertices=0.02 * CUBE.vertices + [3, 0, 0])
    on = sample_mesh(together(CUBE, small), 0)
    points, part = on.points, on.part
    assert part is not None
    assert (points[:, 0] > 2).sum() >= 6 * 11
    assert len(np.unique(part)) == 12 and len(np.unique(part[points[:, 0] > 2])) == 6


def test_prepare_keeps_the_mesh_and_is_deterministic() -> None:
    raw = soup(scaled(tube(48), 10))
    first, second = (prepare(RawScan(raw.vertices, None, raw), 3) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    assert first.mesh is not None and is_closed(first.mesh)
    assert first.mesh.volume() * first.frame.scale**3 == pytest.approx(1000 * tube(48).volume())
    assert len(first.points) == pytest.approx(30_000, rel=0.1)


def test_useless_meshes() -> None:
    bad = Mesh(np.where(np.arange(8)[:, None] == 3, np.nan, CORNERS), CUBE.faces)
    flat = Mesh(CORNERS * [1, 1, 0], CUBE.faces)
    for mesh, sentence in ((bad, "1 of 8 points are NaN"), (flat, "on one plane")):
        with pytest.raises(ScanError, match=rf"m\.stl: .*{sentence}"):
            prepare(RawScan(mesh.vertices, None, mesh, "m.stl"), 0)


def half_round(slope: float) -> Mesh:
    """A bar with a rounded side, and a roof of two slopes (degrees) opposite: every edge turns less than 30 degrees."""
    turn = np.radians(np.arange(0, 181, 3.0))
    arc = [(float(np.cos(t)), float(np.sin(t))) for t in turn + np.pi]
    steps = np.pi / 2 + np.radians(slope * np.arange(1, int(180 / slope)))
    chain = np.cumsum(np.column_stack([np.cos(steps), np.sin(steps)]), axis=0)
    chain *= 2 / -chain[-1, 0]
    return extruded(arc + [(1 + x, y) for x, y in chain[:-1]], 3.0)


def test_planes_that_meet_at_twenty_degrees_are_no_coarse_cylinder() -> None:
    mesh = half_round(20.0)
    parts, _ = smooth_parts(mesh, smooth_edges(mesh, 30))
    assert parts == 3 + 8  # two ends and the round side; the eight planes of the roof
    on = sample_mesh(mesh, 0, 6000)
    points, normals = on.points, on.normals
    roof = (points[:, 1] > 1e-9) & (np.abs(normals[:, 2]) < 0.5)
    plane_normals, _ = mesh.face_normals()
    best = (normals[roof] @ plane_normals.T).max(axis=1)
    assert best.min() > 1 - 1e-9


def test_a_narrow_strip_gets_as_many_points_along_it_as_lie_along_others() -> None:
    mesh = extruded([(0, 0), (1, 0), (1, 1), (0.001, 1), (0, 0.999)], 2.0)
    on = sample_mesh(mesh, 0, 4000)
    points, normals, part = on.points, on.normals, on.part
    assert part is not None
    strip = np.abs(normals @ [-np.sqrt(0.5), np.sqrt(0.5), 0] - 1) < 1e-6
    spacing = np.sqrt(10.0 / 4000)
    assert len(np.unique(part[strip])) == 1
    assert strip.sum() == pytest.approx(2 * 2.0 / spacing, rel=0.1)
    assert np.diff(np.sort(points[strip, 2])).max() < 5 * spacing


def test_fans_split_at_sharp_edges_only() -> None:
    fans = smooth_fans(CUBE, smooth_edges(CUBE, 30))
    assert len(np.unique(fans)) == 6 * 4
    assert len(np.unique(smooth_fans(CUBE, smooth_edges(replace(CUBE), 91)))) == 24  # their arcs would lie far off
    ring = tube(48)
    assert len(np.unique(smooth_fans(ring, smooth_edges(ring, 30)))) == 2 * 48 + 2 * 49


def test_triangles_of_a_scanner_are_told_from_those_of_a_cad_system() -> None:
    rng = np.random.default_rng(0)
    ball = ball_of(40)
    for mesh in (CUBE, tube(36), ball, half_round(20.0)):
        assert not is_measured(mesh)
    rough = replace(ball, vertices=ball.vertices * (1 + 0.004 * rng.normal(size=(len(ball.vertices), 1))))
    assert is_measured(rough)
    assert sample_mesh(rough, 0).part is None


def ball_of(n: int) -> Mesh:
    """A sphere of radius 1 in n / 2 rings of n corners."""
    high, around = np.meshgrid(np.linspace(0, np.pi, n // 2)[1:-1], np.arange(n) * 2 * np.pi / n, indexing="ij")
    ring = np.stack([np.sin(high) * np.cos(around), np.sin(high) * np.sin(around), np.cos(high)], axis=-1)
    at = np.arange(high.size).reshape(high.shape)
    a, b, c, d = at[:-1], at[1:], np.roll(at[1:], -1, axis=1), np.roll(at[:-1], -1, axis=1)
    top, low = np.full(n, high.size), np.full(n, high.size + 1)
    caps = [(at[0], np.roll(at[0], -1), top), (np.roll(at[-1], -1), at[-1], low)]
    faces = [np.column_stack([x.ravel() for x in t]) for t in ((a, b, c), (a, c, d), *caps)]
    return Mesh(np.vstack([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]]), np.vstack(faces))
