"""Proxies, manifold repair and decimation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.scan.scan import Mesh
from sed2cad.topology.carve import fewest_handles
from sed2cad.topology.faceted import decimate
from sed2cad.topology.manifold import (
    euler_number,
    is_closed_manifold,
    nearest_triangles,
    split_edges,
    split_fans,
    twins,
)
from sed2cad.topology.proxy import proxy_mesh, proxy_quality, welded
from sed2cad.topology.samples import first_of_each
from sed2cad.topology.slivers import without_caps

from . import scans

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_two_bodies_that_share_a_vertex_come_apart():
    points = np.random.default_rng(0).random((7, 3))
    second = np.array([0, 4, 5, 6])[TETRAHEDRON]
    faces = np.vstack([TETRAHEDRON, second])
    assert not is_closed_manifold(faces)
    parted = split_fans(points, faces, twins(faces))
    assert is_closed_manifold(parted.faces) and euler_number(parted.faces) == 4
    assert len(parted.vertices) == 8


def test_splitting_edges_keeps_the_surface():
    mesh = welded(scans.box_mesh((1.0, 2.0, 3.0)))
    twin = twins(mesh.faces)
    rng = np.random.default_rng(0)
    for share in (0.2, 0.5, 1.0):
        marked = rng.random(len(twin)) < share
        finer = split_edges(mesh, twin, marked | marked[twin])
        assert is_closed_manifold(finer.faces)
        assert finer.volume() == pytest.approx(6)
    assert len(finer.faces) == 4 * len(mesh.faces)


def _with_caps(mesh: Mesh, rng: np.random.Generator, count: int) -> Mesh:
    """A mesh with corners put on sides of some triangles, and a cap without area between each and the old side."""
    vertices, faces = list(mesh.vertices), list(mesh.faces)
    for _ in range(count):
        a, b, c = faces.pop(int(rng.integers(len(faces))))
        new = len(vertices)
        vertices.append(vertices[a] + rng.uniform(0.2, 0.8) * (vertices[b] - vertices[a]))
        faces += [np.array(t) for t in ((a, new, c), (new, b, c), (a, b, new))]
    return Mesh(np.array(vertices), np.array(faces))


def _least_height(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return float((2 * mesh.face_normals()[1] / longest).min())


@pytest.mark.parametrize("count", [1, 5, 20])
def test_caps_get_their_longest_side_turned(count):
    mesh = welded(scans.box_mesh((1.0, 2.0, 3.0)))
    capped = _with_caps(mesh, np.random.default_rng(count), count)
    assert _least_height(capped) < 1e-9 and is_closed_manifold(capped.faces)
    better = without_caps(capped, 1e-6)
    assert _least_height(better) > 1e-6
    assert is_closed_manifold(better.faces)
    assert better.volume() == pytest.approx(6) and len(better.faces) == len(capped.faces)
    assert without_caps(mesh, 1e-6).faces.tolist() == mesh.faces.tolist()


def test_without_patches_the_proxy_is_poisson():
    scan, _ = scans.scan_of(scans.box_with_hole(), 4000)
    mesh = proxy_mesh(scan)
    assert is_closed_manifold(mesh.faces) and euler_number(mesh.faces) == 0
    assert proxy_quality(mesh, scan) < 0.05


def test_of_several_proxies_the_one_with_the_fewest_handles_then_bodies_is_taken():
    def torn(count: int) -> Mesh:
        faces = np.vstack([TETRAHEDRON + 4 * k for k in range(count)])
        return Mesh(np.tile(np.eye(4, 3), (count, 1)), faces)

    scan, fitted = scans.scan_of(scans.torus(), 1500)
    ring, empty = proxy_mesh(scan, fitted), Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    one, three = torn(1), torn(3)
    assert fewest_handles([empty, ring, three, one]) is one
    assert fewest_handles([empty, ring, three]) is three  # cut-off bodies do not outweigh a handle
    assert fewest_handles([empty, ring]) is ring


def test_quality_sees_what_is_missing():
    scan, fitted = scans.scan_of(scans.box(), 2000)
    mesh = proxy_mesh(scan, fitted)
    assert proxy_quality(mesh, scan) < 0.01
    shrunk = Mesh(mesh.vertices * np.array([1.0, 1.0, 0.5]), mesh.faces)
    assert proxy_quality(shrunk, scan) > 0.2
    inverted = replace(scan, normals=-scan.normals)
    assert proxy_quality(mesh, inverted) > 0.9


@pytest.mark.parametrize("pieces", [scans.torus(), scans.box_with_hole()], ids=["torus", "box with hole"])
def test_decimation_keeps_the_topology(pieces):
    scan, fitted = scans.scan_of(pieces, 3000)
    mesh = proxy_mesh(scan, fitted)
    fewer = decimate(mesh, 500)
    assert len(fewer.faces) <= 500 and is_closed_manifold(fewer.faces)
    assert euler_number(fewer.faces) == 0
    assert fewer.volume() == pytest.approx(mesh.volume(), rel=0.05)
    assert decimate(fewer, 1500) is fewer


def test_a_point_is_nearest_to_the_triangle_that_it_lies_above_however_far_its_centre():
    vertices = np.array([[0.0, 0, 0], [0.0, 0.02, 0], [1.0, 0, 0], [1.0, 0.05, 0]])
    mesh = Mesh(vertices, np.array([[0, 2, 1], [2, 3, 1]]))
    tip = np.array([[0.97, 1e-4, 0.003]])
    assert np.linalg.norm(mesh.centroids() - tip, axis=1).argmin() == 1
    distance, triangle = nearest_triangles(mesh, tip)
    assert triangle[0] == 0
    assert distance[0] == pytest.approx(0.003)


def test_the_first_of_equal_rows_is_found_as_numpy_does() -> None:
    rng = np.random.default_rng(0)
    for rows in (rng.integers(-3, 4, (200, 4)), rng.integers(-(2**40), 2**40, (50, 5)), np.zeros((0, 5), np.int64)):
        assert np.array_equal(first_of_each(rows), np.unique(rows, axis=0, return_index=True)[1])
