"""Corners on all of their surfaces, tangencies included."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sed2cad.geometry.contact import Side
from sed2cad.geometry.corners import solve_corner
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere

X, Y, Z = np.eye(3)


@given(st.lists(st.floats(-0.01, 0.01), min_size=3, max_size=3))
def test_three_planes(shift: list[float]) -> None:
    sides = [Side(Plane(X, 0.1), 1), Side(Plane(Y, 0.2), -1), Side(Plane(Z, 0.3), 1)]
    corner = solve_corner(np.array([0.1, 0.2, 0.3]) + shift, sides, [])
    assert corner.position == pytest.approx([0.1, 0.2, 0.3], abs=1e-12)
    assert corner.residual < 1e-12


def test_four_planes_that_almost_meet_get_the_least_squares_point() -> None:
    tilted = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    sides = [Side(Plane(n, 0.0), 1) for n in (X, Y, Z)] + [Side(Plane(tilted, 1e-3), 1)]
    corner = solve_corner(np.full(3, 0.01), sides, [])
    assert 1e-4 < corner.residual < 1e-3


def test_the_end_of_a_fillet_is_found_by_its_tangencies() -> None:
    """Plane and quarter cylinder are tangent: the distances alone do not say where along X the corner is."""
    plane, fillet, end = Side(Plane(Z, 0.1), 1), Side(Cylinder(Y, 0.05 * Z, 0.05), 1), Side(Plane(Y, 0.0), 1)
    start = np.array([0.008, 0.004, 0.103])
    corner = solve_corner(start, [plane, fillet, end], [(plane, fillet)])
    assert corner.position == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)


def test_a_rolling_ball_corner_where_all_normals_coincide() -> None:
    """Ball, cylinder and plane touch in one point."""
    centre = np.array([0.0, 0.0, 0.1])
    ball, fillet, plane = (
        Side(Sphere(centre, 0.1), 1),
        Side(Cylinder(Y, centre, 0.1), 1),
        Side(Plane(Z, 0.2), 1),
    )
    pairs = [(ball, fillet), (fillet, plane), (ball, plane)]
    corner = solve_corner(np.array([0.006, -0.007, 0.203]), [ball, fillet, plane], pairs)
    assert corner.position == pytest.approx([0.0, 0.0, 0.2], abs=1e-6)


def test_a_corner_does_not_run_away_along_almost_parallel_planes() -> None:
    nearly = np.array([0.03, 0.0, 1.0]) / np.hypot(0.03, 1.0)
    sides = [Side(Plane(Z, 0.0), 1), Side(Plane(nearly, 0.005), 1), Side(Plane(Y, 0.0), 1)]
    corner = solve_corner(np.array([0.0, 0.001, 0.001]), sides, [])
    assert corner.moved < 0.025
