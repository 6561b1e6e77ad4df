"""Points to line, circle, ellipse, or none of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sed2cad.geometry.curves import Circle, Curve, Ellipse, Line
from sed2cad.geometry.recognise import recognise

X, Y, Z = np.eye(3)
T = np.linspace(0, 1.5, 20)
SIMPLE = [Line(X, Y), Circle(X, Z, X, 0.3), Ellipse(X, Z, X, 0.3, 0.2)]


@pytest.mark.parametrize("curve", SIMPLE, ids=lambda c: c.kind)
@given(seed=st.integers(0, 1000))
def test_the_kind_survives_rigid_motion(curve: Curve, seed: int) -> None:
    turn = Rotation.random(random_state=seed)
    points = turn.apply(curve.at(T)) + np.array([0.1, 0.2, 0.3])
    found = recognise(points, closed=False)
    assert type(found) is type(curve)
    assert found is not None and found.distance(points).max() < 1e-9


def test_radius_and_centre_are_exact() -> None:
    found = recognise(Circle(X, Z, X, 0.3).at(T), closed=False)
    assert isinstance(found, Circle)
    assert found.radius == pytest.approx(0.3, abs=1e-12)
    assert found.centre == pytest.approx(X, abs=1e-12)


def test_noise_above_the_tolerance_is_not_recognised() -> None:
    rng = np.random.default_rng(0)
    points = Circle(X, Z, X, 0.3).at(T) + 1e-3 * rng.normal(size=(20, 3))
    assert recognise(points, closed=False) is None


def test_a_helix_is_none_of_them() -> None:
    assert recognise(np.column_stack([np.cos(T), np.sin(T), T]), closed=False) is None


def test_a_closed_curve_is_no_line() -> None:
    assert recognise(np.outer(T, X), closed=True) is None


def test_two_points_are_a_line() -> None:
    assert isinstance(recognise(np.array([X, Y]), closed=False), Line)
