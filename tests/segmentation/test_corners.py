"""What the vertices of a CAD system's mesh tell: planes and round surfaces that hardly differ from each other."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.scan.mesh import planar_facets
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.segmentation.corners import EXACT, Corners, on_surfaces
from sed2cad.segmentation.segment import segment
from tests.segmentation.shapes import FLAT, bar, extruded, frustum, turned


def scan_of(mesh: Mesh) -> Scan:
    return prepare(RawScan(mesh.vertices, None, mesh), 0)


def test_a_plane_between_two_arcs_is_sure_to_be_one_and_a_strip_is_not() -> None:
    mesh = bar(0.4)
    facet = planar_facets(mesh, 30.0)
    normals = mesh.face_normals()[0]
    flat = (np.abs(normals[:, 1]) > 1 - 1e-9) | (np.abs(normals[:, 2]) > 0.5)
    assert len(np.unique(facet[flat])) == 4 and facet[flat].min() >= 0
    assert np.all(facet[~flat] == -1)


def test_a_triangle_alone_is_never_sure() -> None:
    corner = Mesh(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert np.all(planar_facets(corner, 30.0) == -1)


@pytest.mark.parametrize("flat", [FLAT, 0.1])
def test_a_narrow_plane_that_two_cylinders_are_tangent_to_is_found(flat: float) -> None:
    """It is 1/1000 (1/25) of its width off them: a tenth (nearly all) of what the tolerance of a scan allows."""
    found = segment(scan_of(bar(flat)), None)
    assert Counter(patch.kind for patch in found.patches) == {"plane": 4, "cylinder": 2}


def test_a_chamfer_on_a_bore_is_a_cone() -> None:
    found = segment(scan_of(frustum()), None)
    assert Counter(patch.kind for patch in found.patches) == {"plane": 2, "cone": 1}


def test_a_torus_through_three_circles_is_none() -> None:
    """A seat of two cones and planes: its three circles lie on a torus, and the normals hardly tell."""
    seat = [(0.6, 0.3), (0.68, 0.25), (0.8, 0.23)]
    scan = scan_of(turned([(1.0, 0.0), (1.0, 0.5), (0.8, 0.5), *seat[::-1]]))
    found = segment(scan, None)
    kinds = Counter(patch.kind for patch in found.patches)
    assert kinds == {"plane": 3, "cylinder": 2, "cone": 2}


def test_a_fillet_is_a_torus() -> None:
    turn = np.linspace(0, np.pi / 2, 8)
    arc = [(0.8 + 0.2 * float(np.cos(t)), 0.5 + 0.2 * float(np.sin(t))) for t in turn]
    found = segment(scan_of(turned([(1.0, 0.0), *arc])), None)
    assert Counter(patch.kind for patch in found.patches) == {"plane": 2, "cylinder": 1, "torus": 1}


def test_points_of_a_mesh_come_to_lie_on_the_surfaces() -> None:
    scan = scan_of(bar(0.4))
    found = segment(scan, None)
    exact = found.scan.frame.to_world(found.scan.points)
    round_ones = np.concatenate([p.indices for p in found.patches if p.kind == "cylinder"])
    middle = np.sign(exact[round_ones, 0]) * 0.2
    before = scan.frame.to_world(scan.points)[round_ones]
    off = [np.hypot(points[:, 0] - middle, points[:, 1]) - 1 for points in (before, exact[round_ones])]
    on = np.abs(off[1]) < 1e-9
    assert np.abs(off[0]).max() > 1e-3 and on.mean() > 0.99  # the others are the planes' that lie beside the border
    radial = np.column_stack([exact[round_ones, 0] - middle, exact[round_ones, 1], np.zeros(len(middle))])
    np.testing.assert_allclose(found.scan.normals[round_ones][on], radial[on], atol=1e-6)


def cylinder_of(scan: Scan) -> tuple[NDArray[np.int64], Cylinder]:
    """The points of the right half cylinder of a bar, and the cylinder."""
    members = np.flatnonzero((np.abs(scan.normals[:, 2]) < 0.5) & (scan.frame.to_world(scan.points)[:, 0] > FLAT / 2))
    centre = scan.frame.to_unit(np.array([[FLAT / 2, 0.0, 0.0]]))[0]
    return members, Cylinder(np.array([0.0, 0.0, 1.0]), centre, 1 / scan.frame.scale)


def test_only_surfaces_through_nearly_all_vertices_are_settled() -> None:
    scan = scan_of(bar())
    corners = Corners.of(scan)
    assert corners is not None
    members, cylinder = cylinder_of(scan)
    assert corners[members].settle(cylinder)
    assert not corners[members].settle(Cylinder(cylinder.axis, cylinder.point, cylinder.radius + 10 * EXACT))
    assert not corners[members].settle(Plane(np.array([1.0, 0.0, 0.0]), 0.0))
    one_strip = members[np.isin(corners.triangles[members], corners.triangles[members[0]]).all(axis=1)]
    assert not corners[one_strip].settle(cylinder)  # any cylinder goes through so few


def test_a_primitive_moves_onto_the_vertices() -> None:
    scan = scan_of(bar())
    members, cylinder = cylinder_of(scan)
    corners = Corners.of(scan)
    assert corners is not None
    near = Cylinder(cylinder.axis, cylinder.point + 3e-4 * np.eye(3)[0], cylinder.radius * 1.001)
    moved = corners[members].moved(near)
    assert isinstance(moved, Cylinder)
    assert moved.radius == pytest.approx(cylinder.radius, abs=1e-9)
    exact = on_surfaces(scan, corners, [(members, moved, 1)])
    assert np.abs(cylinder.distance(exact.points[members])).max() < 1e-9
    others = np.setdiff1d(np.arange(len(scan.points)), members)
    np.testing.assert_array_equal(exact.points[others], scan.points[others])


def test_only_a_cad_systems_mesh_has_exact_vertices() -> None:
    turn, rng = 2 * np.pi * np.arange(60) / 60, np.random.default_rng(0)
    drum = extruded([(float(np.cos(t)), float(np.sin(t))) for t in turn], 0.2)
    fine = drum.vertices[drum.faces].mean(axis=1)
    assert Corners.of(scan_of(drum)) is not None
    assert Corners.of(prepare(RawScan(np.vstack([drum.vertices, fine]), None), 0)) is None
    rough = Mesh(drum.vertices + rng.normal(0, 0.02, drum.vertices.shape), drum.faces)
    assert Corners.of(scan_of(rough)) is None
