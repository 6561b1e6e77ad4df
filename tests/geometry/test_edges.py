"""Edges whose chains stray, or whose corners lie a little off the curve."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.geometry.chains import length
from sed2cad.geometry.contact import Side
from sed2cad.geometry.curves import Circle, arc_through
from sed2cad.geometry.edges import edge_geometry
from sed2cad.geometry.rulings import common_ruling
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.plane import Plane
from sed2cad.topology.model import Chain
from tests.geometry.swept_parts import through

X, Y, Z = np.eye(3)


def ring(angles: list[float], heights: list[float], radius: float = 0.015) -> np.ndarray:
    turned = np.radians(angles)
    return np.column_stack([radius * np.cos(turned), radius * np.sin(turned), heights])


def around(curve: Circle, points: np.ndarray) -> float:
    """Full turns of points about the axis of a circle."""
    angles = curve.parameters(points)
    return float((np.mod(np.diff(angles, append=angles[:1]) + np.pi, 2 * np.pi) - np.pi).sum() / (2 * np.pi))


@pytest.mark.parametrize("way", [1, -1])
def test_a_closed_arc_goes_around_as_its_points_do_however_unevenly(way: int) -> None:
    points = ring([0, 120, 240, *range(250, 360, 10)], [0.0] * 14)[::way]
    circle = Circle(np.zeros(3), Z, X, 0.015)
    sampled = arc_through(circle, points, True).sampled(40)[:-1]
    assert around(circle, sampled) == pytest.approx(way)
    assert around(circle, points) == pytest.approx(way)


@pytest.mark.parametrize("way", [1, -1])
def test_a_crooked_ring_of_few_points_goes_around_a_bore_as_it_was_traced(way: int) -> None:
    points = ring([-113, -43, -19, 15, 93], [-0.001, -0.001, -0.003, -0.008, -0.02])[::way]
    bore, floor = Side(Cylinder(Z, np.zeros(3), 0.015), -1), Side(Plane(Z, 0.0), 1)
    edge = edge_geometry(Chain(points, 0, 1, -1, -1), bore, floor, "crossing", np.zeros((0, 3)))
    curve = edge.arc.curve
    assert isinstance(curve, Circle) and edge.residual < 1e-12
    assert around(Circle(np.zeros(3), Z, X, 0.015), edge.arc.sampled(40)[:-1]) == pytest.approx(way)


@pytest.mark.parametrize("off", [3e-4, 1.4e-3])
def test_an_edge_does_not_turn_back_at_a_corner_beside_its_curve(off: float) -> None:
    """The corner of a third face that misses the curve of two."""
    cone, plane = Cone(-Z, 0.4 * Z, 0.6), Plane(np.array([0.0, 1.0, 1.0]) / np.sqrt(2), 0.2)
    a, b = Side(cone, 1), Side(plane, 1)
    heights = np.linspace(0.083, 0.073, 12)
    y = 0.2 * np.sqrt(2) - heights
    x = np.sqrt((np.tan(0.6) * (0.4 - heights)) ** 2 - y**2)
    points = np.column_stack([x, y, heights])
    corners = points[[0, -1]] + off * np.array([[0.5, -0.2, 0.8], [0.6, 0.0, -0.8]])
    edge = edge_geometry(Chain(points, 0, 1, 0, 1), a, b, "crossing", corners)
    sampled = edge.arc.sampled(200)
    assert length(sampled, False) < 1.05 * np.linalg.norm(corners[1] - corners[0])
    assert (np.diff(sampled @ (points[-1] - points[0])) > 0).all()
    assert edge.residual < 2 * off


def test_the_edge_where_a_wavy_surface_runs_out_into_a_plane_is_straight() -> None:
    """Along the direction of both, even where the traced chain wanders over the place where they touch."""
    t = np.linspace(0, 1, 30)
    wavy = Extrusion(X, np.zeros(3), Y, through(np.column_stack([0.3 * t, 0.05 * t**3])))
    flat = Plane(Z, 0.0)
    s = np.linspace(0, 1, 40)
    chain = np.column_stack([0.9 * s, 0.03 * np.sin(7 * s) ** 2, np.zeros(40)])
    corners = np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0]])
    edge = edge_geometry(Chain(chain, 0, 1, 0, 1), Side(wavy, 1), Side(flat, 1), "resting", corners)
    assert edge.arc.curve.kind == "line"
    assert edge.residual < 1e-6
    assert edge.arc.ends() == pytest.approx(corners)


def test_between_a_corner_and_itself_there_is_no_straight_edge() -> None:
    bore = Cylinder(Z, np.zeros(3), 0.1)
    assert common_ruling(bore, Plane(X, 0.05), X, X + Z) is not None
    assert common_ruling(bore, Plane(X, 0.05), X, X + Z + 0.1 * Y) is None
    assert common_ruling(bore, Plane(X, 0.05), X, X) is None
