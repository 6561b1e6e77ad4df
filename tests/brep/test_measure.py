"""Distances from points to solids."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.brep.measure import Triangles, deviations, nearest_triangles, point_triangle, tessellate
from tests.brep.made import part, shape


def test_point_triangle_against_a_fine_sampling() -> None:
    rng = np.random.default_rng(0)
    a, b, c = rng.normal(size=(3, 3))
    u, v = np.meshgrid(np.linspace(0, 1, 401), np.linspace(0, 1, 401))
    inside = u + v <= 1
    fine = a + u[inside][:, None] * (b - a) + v[inside][:, None] * (c - a)
    for p in 2 * rng.normal(size=(20, 3)):
        assert point_triangle(p, a, b, c) == pytest.approx(np.linalg.norm(fine - p, axis=1).min(), abs=1e-2)


def test_nearest_triangles_are_the_nearest_of_all() -> None:
    rng = np.random.default_rng(1)
    mesh = Triangles(rng.normal(size=(60, 3)), np.arange(60).reshape(20, 3), np.zeros(20, np.int64))
    points = 2 * rng.normal(size=(300, 3))
    every = point_triangle(points[:, None], *mesh.corners())
    distances, numbers = nearest_triangles(points, mesh)
    assert distances == pytest.approx(every.min(axis=1))
    assert (numbers == every.argmin(axis=1)).all()


def test_a_tessellation_closes_and_faces_outwards() -> None:
    mesh = tessellate(shape("stepped_shaft"), 0.01)
    a, b, c = mesh.corners()
    size = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert size == pytest.approx(part("stepped_shaft").volume, rel=0.01)
    assert set(mesh.owner) == set(range(5))


def test_distances_are_not_blurred_by_the_tessellation() -> None:
    given = part("box_with_hole")
    world = [f.primitive.scaled(given.frame.scale, given.frame.origin) for f in given.fitted]
    angles = np.linspace(0, 6, 50)
    wall = np.column_stack([12 + 4 * np.cos(angles), 9 + 4 * np.sin(angles), np.full(50, 5.0)])
    found = deviations(shape("box_with_hole"), world, wall, 0.1)
    assert found.max < 1e-12
    assert set(found.faces) == {6}


def test_a_point_beyond_the_border_is_measured_to_the_border() -> None:
    given = part("box")
    world = [f.primitive.scaled(given.frame.scale, given.frame.origin) for f in given.fitted]
    found = deviations(shape("box"), world, np.array([[33.0, 10.0, 14.0], [15.0, 10.0, 10.5]]), 0.03)
    assert found.distances == pytest.approx([5.0, 0.5])
    assert found.rms_by_face(6)[4] == pytest.approx(0.5) or np.isnan(found.rms_by_face(6)).any()
