"""Curves: parameters, arcs along points, scaling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sed2cad.geometry.curves import Arc, Circle, Curve, Ellipse, Interpolated, Line, arc_through

X, Y, Z = np.eye(3)
CENTRE = np.array([1.0, 2.0, 3.0])
ANGLES = np.linspace(0, 2 * np.pi, 40, endpoint=False)
CURVES = [
    Line(CENTRE, X),
    Circle(CENTRE, Z, X, 2.0),
    Ellipse(CENTRE, Z, X, 3.0, 1.0),
    Interpolated(Circle(CENTRE, Z, X, 2.0).at(ANGLES), True),
]


@pytest.mark.parametrize("curve", CURVES, ids=lambda c: c.kind)
def test_parameters_invert_at(curve: Curve) -> None:
    at = np.linspace(0.1, 3.0, 17)
    assert curve.parameters(curve.at(at)) == pytest.approx(at, abs=1e-9)


@pytest.mark.parametrize("curve", CURVES, ids=lambda c: c.kind)
def test_reversed_runs_the_other_way(curve: Curve) -> None:
    points = curve.at(np.linspace(0.1, 2.0, 5))
    back = curve.reversed()
    assert back.distance(points).max() < 1e-6
    assert (np.diff(np.unwrap(back.parameters(points))) < 0).all()


@pytest.mark.parametrize("curve", CURVES, ids=lambda c: c.kind)
@pytest.mark.parametrize("scale", [1e-3, 25.4])
def test_scaled_arcs_are_the_scaled_points(curve: Curve, scale: float) -> None:
    origin = np.array([10.0, -5.0, 7.0])
    arc = Arc(curve, 0.2, 1.7)
    assert arc.scaled(scale, origin).sampled(9) == pytest.approx(scale * arc.sampled(9) + origin, abs=1e-9)


def test_ellipse_distance_is_to_the_nearest_point() -> None:
    ellipse = Ellipse(np.zeros(3), Z, X, 3.0, 1.0)
    points = np.array([[0.0, 2.0, 0.0], [4.0, 0.0, 0.0], [0.5, 0.1, 0.0], [0.0, 0.0, 1.0]])
    fine = ellipse.at(np.linspace(0, 2 * np.pi, 200001))
    expected = [np.linalg.norm(fine - p, axis=1).min() for p in points]
    assert ellipse.distance(points) == pytest.approx(expected, abs=1e-6)


def test_closed_interpolation_is_smooth_all_round() -> None:
    curve = Interpolated(Circle(CENTRE, Z, X, 2.0).at(ANGLES), True)
    samples = curve.at(np.linspace(0, curve.length, 1001))
    assert np.linalg.norm(samples - CENTRE, axis=1) == pytest.approx(2.0, abs=1e-5)
    ends = np.array([0.0, curve.length])
    assert curve.spline(ends, 1)[0] == pytest.approx(curve.spline(ends, 1)[1], abs=1e-9)
    assert curve.spline(ends, 2)[0] == pytest.approx(curve.spline(ends, 2)[1], abs=1e-6)


@given(
    first=st.floats(-3.1, 3.1),
    sweep=st.floats(0.05, 6.2),
    backwards=st.booleans(),
)
def test_an_arc_runs_along_its_points(first: float, sweep: float, backwards: bool) -> None:
    circle = Circle(CENTRE, Z, X, 2.0)
    points = circle.at(first + np.linspace(0, -sweep if backwards else sweep, 12))
    arc = arc_through(circle, points, closed=False)
    assert arc.last - arc.first == pytest.approx(sweep, abs=1e-6)
    assert arc.sampled(12) == pytest.approx(points, abs=1e-6)


@pytest.mark.parametrize("way", [1, -1])
def test_a_closed_arc_turns_once_the_way_of_its_points(way: int) -> None:
    circle = Circle(CENTRE, Z, X, 2.0)
    points = circle.at(0.7 + ANGLES[::way])
    arc = arc_through(circle, points, closed=True)
    assert arc.last - arc.first == pytest.approx(2 * np.pi)
    assert arc.sampled(41)[:-1] == pytest.approx(points, abs=1e-9)


def test_noise_larger_than_a_step_does_not_unwind_an_arc() -> None:
    rng = np.random.default_rng(0)
    circle = Circle(np.zeros(3), Z, X, 0.01)
    clean = circle.at(np.linspace(0, np.pi / 2, 12))
    noisy = clean + 0.004 * rng.normal(size=clean.shape)
    noisy[[0, -1]] = clean[[0, -1]]
    arc = arc_through(circle, noisy, closed=False)
    assert arc.last - arc.first == pytest.approx(np.pi / 2)


def test_a_chord_across_a_fillet_is_its_short_arc() -> None:
    """Two points of a coarse mesh: the chord between them passes the axis on its far side."""
    circle = Circle(np.zeros(3), Z, X, 1.0)
    ends = circle.at(np.array([0.0, np.pi / 2]))
    chord = np.linspace(circle.at(np.array([-0.5]))[0], circle.at(np.array([2.2]))[0], 12) - 0.15 * (X + Y)
    arc = arc_through(circle, np.vstack([ends[:1], chord[1:-1], ends[1:]]), closed=False)
    assert arc.last - arc.first == pytest.approx(np.pi / 2)


def test_a_circle_can_be_started_anywhere() -> None:
    circle = Circle(CENTRE, Z, X, 2.0)
    assert circle.started_at(1.0).at(np.array([0.0])) == pytest.approx(circle.at(np.array([1.0])))
