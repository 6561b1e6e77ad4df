"""Closed forms, gradients, charts and round trips of the five analytic primitives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.refine import bent, centred
from sed2cad.primitives.registry import ANALYTIC_KINDS, KINDS, primitive_class
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame, unit
from tests.primitives.patches import Z, random_rotation, rotated

ORIGIN = np.zeros(3)


def examples() -> list[Primitive]:
    axis = unit(np.array([0.2, 1.0, -3.0]))
    place = np.array([0.1, 0.2, 0.3])
    return [
        Plane(unit(np.array([1.0, 2.0, 3.0])), 0.3),
        Cylinder(axis, place, 0.4),
        Cone(axis, place, 0.4),
        Cone(axis, place, 0.02, reach=0.7),
        Sphere(place, 0.4),
        Torus(axis, place, 0.5, 0.2),
    ]


def cloud(seed: int = 0, count: int = 60) -> Array:
    return np.random.default_rng(seed).normal(size=(count, 3))


@pytest.mark.parametrize(
    ("primitive", "point", "distance"),
    [
        (Plane(Z, 2.0), (5, 6, 5), 3.0),
        (Cylinder(Z, ORIGIN, 2.0), (3, 4, 9), 3.0),
        (Cylinder(Z, ORIGIN, 2.0), (0, 0, 9), -2.0),
        (Cone(Z, ORIGIN, np.pi / 4), (2, 0, 0), np.sqrt(2)),
        (Cone(Z, ORIGIN, np.pi / 4), (0, 0, 2), -np.sqrt(2)),
        (Cone(Z, ORIGIN, np.pi / 4), (0, 0, -2), 2.0),
        (Sphere(ORIGIN, 1.0), (0, 3, 4), 4.0),
        (Torus(Z, ORIGIN, 5.0, 1.0), (5, 0, 3), 2.0),
        (Torus(Z, ORIGIN, 5.0, 1.0), (0, 0, 0), 4.0),
    ],
)
def test_distance_in_closed_form(primitive: Primitive, point: tuple, distance: float) -> None:
    assert primitive.distance(np.array([point], dtype=float)) == pytest.approx(distance)


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_jacobian_is_the_derivative_by_the_chart(primitive: Primitive) -> None:
    points, step = cloud(), 1e-6
    columns = [
        (primitive.moved(step * e).distance(points) - primitive.moved(-step * e).distance(points))
        / (2 * step)
        for e in np.eye(primitive.freedom)
    ]
    assert primitive.jacobian(points) == pytest.approx(np.column_stack(columns), abs=2e-7, rel=1e-6)


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_normal_is_the_gradient(primitive: Primitive) -> None:
    points, step = cloud(1), 1e-6
    gradient = [
        (primitive.distance(points + step * e) - primitive.distance(points - step * e)) / (2 * step)
        for e in np.eye(3)
    ]
    assert primitive.normal(points) == pytest.approx(np.column_stack(gradient), abs=1e-8)


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_feet_lie_on_the_surface(primitive: Primitive) -> None:
    assert primitive.distance(primitive.project(cloud(2))) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_parameters_round_trip(primitive: Primitive) -> None:
    again = primitive_class(primitive.kind).from_parameters(primitive.parameters())
    assert again.distance(cloud()) == pytest.approx(primitive.distance(cloud()))


def test_the_step_along_a_short_arc_is_the_chart_to_first_order() -> None:
    torus, points = Torus(unit(np.array([0.2, 1.0, -3.0])), np.array([0.1, 0.2, 0.3]), 0.5, 0.2), cloud(4)
    near = torus.centre + 0.5 * tangent_frame(torus.axis)[0]
    for step in 1e-6 * np.eye(7):
        change = bent(torus, step, near).distance(points) - bent(torus, -step, near).distance(points)
        assert change / 2e-6 == pytest.approx(torus.jacobian(points) @ step / 1e-6, abs=2e-7, rel=1e-6)
    grown = bent(torus, np.array([0, 0, 0, 0, 0, 9.0, 0]), near)
    assert grown.major_radius == pytest.approx(5.0)  # ten times at most
    assert bent(torus, 0.1 * np.ones(7), torus.centre).major_radius == pytest.approx(0.6)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.1, 50))
def test_rigid_motion_and_scale_move_the_distances_along(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    points, turn, shift = cloud(seed), random_rotation(rng), rng.normal(size=3)
    for primitive in examples():
        turned = rotated(primitive, turn, shift)
        assert turned.distance(points @ turn.T + shift) == pytest.approx(
            primitive.distance(points), abs=1e-12
        )
        larger = primitive.scaled(scale, shift)
        expected = scale * primitive.distance(points)
        assert larger.distance(scale * points + shift) == pytest.approx(expected, abs=1e-11 * scale)


def test_a_pivot_amid_the_points_changes_no_surface() -> None:
    for primitive in examples():
        same = centred(primitive, cloud(3) + 0.5)
        assert same.distance(cloud()) == pytest.approx(primitive.distance(cloud()), abs=1e-12)


def test_a_cone_closed_beyond_a_cylinder_opens_the_other_way() -> None:
    cone = Cone(Z, np.array([0.0, 0.0, -10.0]), 0.01, reach=10.0)
    moved = cone.moved(np.array([0, 0, 0, 0, 0, -0.02]))
    assert moved.half_angle == pytest.approx(0.01)
    assert moved.axis == pytest.approx(-Z)
    assert moved.distance(np.array([[0.1, 0.0, 0.0]])) == pytest.approx(
        cone.distance(np.array([[0.1, 0, 0]]))
    )


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_tangent_frame_is_right_handed(vector: tuple[float, float, float]) -> None:
    axis = unit(np.array(vector))
    x, y = tangent_frame(axis)
    frame = np.stack([x, y, axis])
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1)


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("plane", {"normal": [0, 0, 0], "offset": 1}),
        ("plane", {"normal": [0, 0, 1]}),
        ("cylinder", {"axis": [0, 0, 1], "point": [0, 0, 0], "radius": -1}),
        ("cylinder", {"axis": [0, 0], "point": [0, 0, 0], "radius": 1}),
        ("cone", {"axis": [0, 0, 1], "apex": [0, 0, 0], "half_angle": 2}),
        ("sphere", {"centre": [0, 0, float("nan")], "radius": 1}),
        ("torus", {"axis": [0, 0, 1], "centre": [0, 0, 0], "major_radius": 1, "minor_radius": "wide"}),
    ],
)
def test_senseless_parameters_are_refused(kind: str, parameters: dict) -> None:
    with pytest.raises(ValueError):
        primitive_class(kind).from_parameters(parameters)


def test_the_registry_knows_every_kind() -> None:
    assert [primitive_class(kind).kind for kind in KINDS] == list(KINDS)
    assert "bspline" not in ANALYTIC_KINDS
    with pytest.raises(ValueError, match="ellipsoid"):
        primitive_class("ellipsoid")


def test_no_normal_is_undefined() -> None:
    for primitive in examples():
        centre = getattr(primitive, "centre", getattr(primitive, "apex", getattr(primitive, "point", ORIGIN)))
        lengths = np.linalg.norm(primitive.normal(np.stack([centre, centre])), axis=1)
        assert lengths == pytest.approx(1)
