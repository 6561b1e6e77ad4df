"""Closed forms: every point of the curve lies on both surfaces; where they touch, the normals agree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sed2cad.geometry.intersections import exact_intersections
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus

X, Y, Z = np.eye(3)
O = np.zeros(3)
CYLINDER, SPHERE, TORUS = Cylinder(Z, O, 0.2), Sphere(0.1 * Z, 0.3), Torus(Z, O, 0.25, 0.1)
CONE = Cone(Z, -0.4 * Z, float(np.arctan(0.5)))
TILTED = np.array([0.6, 0.0, 0.8])

CROSSING: list[tuple[Primitive, Primitive, list[str]]] = [
    (Plane(X, 0.1), Plane(Y, 0.2), ["line"]),
    (Plane(X, 0.1), Plane(TILTED, 0.2), ["line"]),
    (Plane(Z, 0.1), CYLINDER, ["circle"]),
    (Plane(X, 0.1), CYLINDER, ["line", "line"]),
    (Plane(TILTED, 0.1), CYLINDER, ["ellipse"]),
    (Plane(-Z, 0.1), CONE, ["circle"]),
    (Plane(TILTED, 0.1), SPHERE, ["circle"]),
    (Plane(Z, 0.05), TORUS, ["circle", "circle"]),
    (Plane(X, 0.0), TORUS, ["circle", "circle"]),
    (CYLINDER, CONE, ["circle"]),
    (CYLINDER, SPHERE, ["circle", "circle"]),
    (CYLINDER, TORUS, ["circle", "circle"]),
    (CONE, Cone(-Z, 0.4 * Z, 0.5), ["circle"]),
    (CONE, TORUS, ["circle", "circle"]),
    (SPHERE, Sphere(np.array([0.2, 0.1, 0.0]), 0.25), ["circle"]),
    (SPHERE, TORUS, ["circle", "circle"]),
]

TOUCHING: list[tuple[Primitive, Primitive, str]] = [
    (Plane(X, 0.2), CYLINDER, "line"),
    (Plane(-X, 0.2), CYLINDER, "line"),
    (Plane(Z, 0.1), TORUS, "circle"),
    (Cylinder(Z, O, 0.35), TORUS, "circle"),
    (Cylinder(Z, O, 0.15), TORUS, "circle"),
    (Cylinder(Z, O, 0.3), SPHERE, "circle"),
    (Cylinder(Y, 0.25 * X, 0.1), TORUS, "circle"),
    (Sphere(O, 0.35), TORUS, "circle"),
    (Sphere(O, 0.15), TORUS, "circle"),
]


def _name(value: object) -> str | None:
    return value.kind if isinstance(value, Primitive) else None


@pytest.mark.parametrize(("a", "b", "kinds"), CROSSING, ids=_name)
def test_crossings_lie_on_both(a: Primitive, b: Primitive, kinds: list[str]) -> None:
    for one, other in ((a, b), (b, a)):
        curves = exact_intersections(one, other, tangent=False)
        assert [c.kind for c in curves] == kinds
        for curve in curves:
            points = curve.at(np.linspace(0, 2, 30))
            assert np.abs(a.distance(points)).max() < 1e-12
            assert np.abs(b.distance(points)).max() < 1e-12


@pytest.mark.parametrize(("a", "b", "kind"), TOUCHING, ids=_name)
def test_contacts_lie_on_both_with_one_normal(a: Primitive, b: Primitive, kind: str) -> None:
    for one, other in ((a, b), (b, a)):
        (curve,) = exact_intersections(one, other, tangent=True)
        assert curve.kind == kind
        points = curve.at(np.linspace(0, 2, 30))
        assert np.abs(a.distance(points)).max() < 1e-12
        assert np.abs(b.distance(points)).max() < 1e-12
        assert np.abs(np.cross(a.normal(points), b.normal(points))).max() < 1e-9


def test_surfaces_that_miss_each_other_have_none() -> None:
    assert exact_intersections(Plane(X, 0.3), CYLINDER, tangent=False) == []
    assert exact_intersections(Plane(X, 0.3), Plane(X, 0.1), tangent=False) == []
    assert exact_intersections(CYLINDER, Cylinder(X, O, 0.1), tangent=False) == []
    assert exact_intersections(Plane(Z, -0.5), CONE, tangent=False) == []  # the nappe that is not there


def test_a_fillet_a_hair_off_its_plane_gets_the_line_midway() -> None:
    (line,) = exact_intersections(Plane(X, 0.2004), CYLINDER, tangent=True)
    assert line.at(np.zeros(1))[0, 0] == pytest.approx(0.2002)


def test_it_does_not_matter_where_the_part_lies() -> None:
    turn = Rotation.random(random_state=3)
    way, shift = turn.apply(Z), np.array([0.3, -0.2, 0.5])
    plane = Plane(way, float(way @ shift) + 0.1)
    (circle,) = exact_intersections(plane, Cylinder(way, shift, 0.2), tangent=False)
    assert circle.kind == "circle"
    assert np.abs(plane.distance(circle.at(np.linspace(0, 6, 20)))).max() < 1e-12
