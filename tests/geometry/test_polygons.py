"""Loops in space are filled with triangles that follow a cloud."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.errors import AssemblyError
from sed2cad.geometry.bulges import bulged
from sed2cad.geometry.polygons import MOST_CORNERS, Cloud, Polygon, filled
from sed2cad.geometry.triangles import point_triangle

UP = np.array([0.0, 0.0, 1.0])


def around(radius: float, count: int, turned: bool = False) -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)[:: -1 if turned else 1]
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])


def flat_cloud(inner: float, outer: float) -> Cloud:
    rng = np.random.default_rng(0)
    radius = np.sqrt(rng.uniform(inner**2, outer**2, 4000))
    angle = rng.uniform(0, 2 * np.pi, 4000)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    return Cloud(points, np.tile(UP, (4000, 1)))


def areas(polygon: Polygon) -> np.ndarray:
    a, b, c = np.moveaxis(np.array(polygon.points)[np.array(polygon.triangles)], 1, 0)
    return np.cross(b - a, c - a) / 2


def test_a_ring_is_filled_without_its_hole() -> None:
    outer, inner = around(0.4, 24), around(0.2, 12, turned=True)
    vertices = np.vstack([outer, inner])
    loops = [[(k, k) for k in range(24)], [(k, k) for k in range(24, 36)]]
    polygon = filled(loops, vertices, flat_cloud(0.2, 0.4))
    truth = 24 / 2 * 0.16 * np.sin(2 * np.pi / 24) - 12 / 2 * 0.04 * np.sin(2 * np.pi / 12)
    assert areas(polygon)[:, 2].sum() == pytest.approx(truth, rel=1e-12)
    assert (areas(polygon)[:, 2] > 0).all()
    assert len(polygon.triangles) == 36  # of two loops: all corners, two of them twice, less 2


def test_loops_that_share_a_vertex_are_joined_there() -> None:
    vertices = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0], [0.2, 0.1, 0], [0.1, 0.2, 0.0]])
    loops = [[(0, 0), (1, 1), (2, 2), (3, 3)], [(0, 4), (5, 5), (4, 6)]]
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 0.3, (4000, 2)), np.zeros(4000)])
    polygon = filled(loops, vertices, Cloud(points, np.tile(UP, (4000, 1))))
    assert all(name >= 0 for _, name in polygon.corners)  # no bridge
    assert areas(polygon)[:, 2].sum() == pytest.approx(0.09 - 0.015, rel=1e-12)


def test_a_dome_gets_points_inside() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(4000, 3))
    points *= 0.3 / np.linalg.norm(points, axis=1)[:, None]
    points[:, 2] = np.abs(points[:, 2])
    cloud = Cloud(points, points / 0.3)
    polygon = filled([[(k, k) for k in range(24)]], around(0.3, 24), cloud)
    before = _farthest(polygon, points)
    bulged(polygon, cloud)
    assert before > 0.1
    assert _farthest(polygon, points) < 0.025
    assert len(polygon.triangles) == 22 + 2 * (len(polygon.points) - 24)  # Euler's formula for a disc


def _farthest(polygon: Polygon, points: np.ndarray) -> float:
    a, b, c = np.moveaxis(np.array(polygon.points)[np.array(polygon.triangles)], 1, 0)
    return float(point_triangle(points[::8, None], a[None], b[None], c[None]).min(axis=1).max())


@pytest.mark.parametrize("count", [0, 2, MOST_CORNERS + 1])
def test_too_few_or_too_many_corners_are_refused(count: int) -> None:
    loop = [(k, k) for k in range(count)]
    with pytest.raises(AssemblyError, match="facets"):
        filled([loop] if loop else [], around(0.4, max(count, 1)), flat_cloud(0.0, 0.4))
