"""Proxies, manifold repair and decimation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.scan.scan import Mesh
from sed2cad.topology.faceted import decimate
from sed2cad.topology.manifold import euler_number, is_closed_manifold, split_edges, split_fans, twins
from sed2cad.topology.proxy import proxy_mesh, proxy_quality, welded

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


def test_without_patches_the_proxy_is_poisson():
    scan, _ = scans.scan_of(scans.box_with_hole(), 4000)
    mesh = proxy_mesh(scan)
    assert is_closed_manifold(mesh.faces) and euler_number(mesh.faces) == 0
    assert proxy_quality(mesh, scan) < 0.05


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
