"""Each relation: zero where it holds by construction, its derivative, and primitives made to obey it."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.fitting import fit
from sed2cad.primitives import solve_relations
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.oriented_fit import oriented_fit
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.proposals import piece, ways_to_touch
from sed2cad.primitives.relations import (
    EQUATIONS,
    SAME,
    TANGENCIES,
    Equation,
    placement,
    placement_jacobian,
    residual_jacobian,
    residuals,
)
from sed2cad.primitives.settle import settle
from sed2cad.primitives.solve_relations import Evidence, Relation, satisfy, violations
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import unit
from tests.primitives.patches import Z, cylinder_patch, plane_patch, random_rotation, rotated
from tests.primitives.test_analytic import examples

X, O = np.array([1.0, 0.0, 0.0]), np.zeros(3)
BALL_ON_CONE = Sphere(2 * Z, 2 * np.sin(0.4))
TANGENT = [
    (Plane(X, 1.0), Cylinder(Z, O, 1.0)),
    (Plane(np.cos(0.4) * X - np.sin(0.4) * Z, 0.0), Cone(Z, O, 0.4, reach=1.0)),
    (Plane(X, -1.0), Sphere(O, 1.0)),
    (Plane(Z, 0.2), Torus(Z, O, 1.0, 0.2)),
    (Cylinder(Z, O, 1.0), Cylinder(Z, 1.5 * X, 0.5)),
    (Cylinder(Z, O, 1.0), Cylinder(Z, 0.7 * X, 0.3)),
    (Cylinder(Z, O, 1.0), Sphere(5 * Z, 1.0)),
    (Cylinder(Z, O, 1.0), Torus(Z, 3 * Z, 1.2, 0.2)),
    (Cylinder(Z, O, 1.0), Torus(Z, 3 * Z, 0.8, 0.2)),
    (Cylinder(Z, 2 * X, 0.5), Torus(np.array([0.0, 1.0, 0.0]), 3 * Z, 2.0, 0.5)),
    (Cone(Z, O, 0.4, reach=1.0), BALL_ON_CONE),
    (Cone(Z, O, 0.4, reach=1.0), Torus(Z, 2 * Z, 1.5, 1.5 * np.cos(0.4) - 2 * np.sin(0.4))),
    (Sphere(2 * X, 0.5), Torus(Z, O, 2.0, 0.5)),
    (Sphere(O, 2.0), Torus(Z, 1.5 * Z, 2.0, 0.5)),
    (Torus(Z, O, 1.0, 0.2), Torus(Z, O, 1.5, 0.3)),
]


def least(ways: tuple[Equation, ...], a: Primitive, b: Primitive) -> float:
    p, q = placement(a)[None], placement(b)[None]
    return min(np.abs(residuals(way, p, q, np.array([sign]))).max() for way in ways for sign in (1.0, -1.0))


@pytest.mark.parametrize(("a", "b"), TANGENT, ids=lambda p: p.kind)
def test_tangencies_vanish_on_tangent_pairs_in_any_pose(a: Primitive, b: Primitive) -> None:
    rng = np.random.default_rng(0)
    ways = TANGENCIES[a.kind, b.kind]
    for _ in range(3):
        turn, shift = random_rotation(rng), rng.normal(size=3)
        assert least(ways, rotated(a, turn, shift), rotated(b, turn, shift)) < 1e-12
        assert least(ways, a, b) < 1e-12
        assert least(ways, a, b.scaled(1.1, np.array([-0.03, 0.05, 0.07]))) > 0.01


def sense_where_they_touch(a: Primitive, b: Primitive) -> float:
    """Whether their own normals agree there (1) or oppose (-1): found by going from one to the other and back."""
    points = np.random.default_rng(1).uniform(-4, 4, (500, 3))
    for _ in range(300):
        points = a.project(b.project(points))
    points = points[np.abs(b.distance(points)) < 0.01]
    agreement = (a.normal(points) * b.normal(points)).sum(axis=1)
    most = float(agreement[np.argmax(np.abs(agreement))])  # an apex touches otherwise
    assert abs(most) > 0.99
    return np.sign(most)


@pytest.mark.parametrize(("a", "b"), TANGENT, ids=lambda p: p.kind)
def test_the_normals_tell_tangencies_apart(a: Primitive, b: Primitive) -> None:
    p, q = placement(a)[None], placement(b)[None]
    for sense in (1, -1):
        ways = ways_to_touch(TANGENCIES[a.kind, b.kind], sense)
        misfit = min((np.abs(residuals(way, p, q, np.array([sign]))).max() for way, sign in ways), default=np.inf)
        assert (misfit < 1e-12) == (sense == sense_where_they_touch(a, b))


def test_a_pair_on_one_surface_is_the_same() -> None:
    for primitive in examples():
        assert least((SAME[primitive.kind],), primitive, primitive) < 1e-12
        assert least((SAME[primitive.kind],), primitive, primitive.scaled(1.5, O)) > 1e-3


def test_placements_follow_the_chart() -> None:
    for primitive in examples():
        step = 1e-6
        columns = [
            (placement(primitive.moved(step * e)) - placement(primitive.moved(-step * e))) / (2 * step)
            for e in np.eye(primitive.freedom)
        ]
        assert placement_jacobian(primitive) == pytest.approx(np.column_stack(columns), abs=1e-8)


def test_the_complex_step_is_the_derivative() -> None:
    rng, step = np.random.default_rng(1), 1e-6
    equations = [*EQUATIONS.values(), *SAME.values(), *(way for ways in TANGENCIES.values() for way in ways)]
    for equation in equations:
        both = rng.uniform(0.3, 1.2, (1, 16))
        sign = np.array([-1.0])
        columns = []
        for e in step * np.eye(16):
            up, down = both + e, both - e
            change = residuals(equation, up[:, :8], up[:, 8:], sign) - residuals(
                equation, down[:, :8], down[:, 8:], sign
            )
            columns.append(change[0] / (2 * step))
        found = residual_jacobian(equation, both[:, :8], both[:, 8:], sign)[0]
        assert found == pytest.approx(np.column_stack(columns), abs=1e-7)


def test_satisfied_relations_hold_exactly_and_the_points_still_pull() -> None:
    """A slanted plane and a cylinder: afterwards tangent, and as near to their points as tangency allows."""
    rng = np.random.default_rng(2)
    flat = plane_patch(rng, 200).points + 0.1005 * Z
    round_ = cylinder_patch(rng, 200).points[:, [2, 0, 1]]  # about x
    primitives: dict[int, Primitive] = {
        0: Plane(np.array([0.01, 0.0, 1.0]) / np.hypot(1, 0.01), 0.1),
        1: Cylinder(np.array([1.0, 0.01, 0.0]) / np.hypot(1, 0.01), O, 0.1),
    }
    relation = Relation("tangent", (0, 1), TANGENCIES["plane", "cylinder"][0], -1.0)
    evidence = {0: Evidence(flat, np.full(200, 1e6)), 1: Evidence(round_, np.full(200, 1e6))}
    solved = satisfy(primitives, [relation], evidence)
    assert violations(solved, [relation]).max() < 1e-11
    plane, cylinder = solved[0], solved[1]
    assert isinstance(plane, Plane) and isinstance(cylinder, Cylinder)
    assert np.abs(plane.distance(flat)).max() < 6e-4
    assert np.abs(cylinder.distance(round_)).max() < 6e-4
    assert 0.1 < plane.offset < 0.1005


def test_given_relations_are_not_dropped_for_proposed_ones() -> None:
    """Two parallel planes 0.3 apart, known to 1e-4: proposed to be one, or at right angles, they stay parallel."""
    flat = plane_patch(np.random.default_rng(3), 50).points
    up = np.tile(Z, (50, 1))
    pieces = {k: piece(Plane(Z, 0.3 * k), flat + 0.3 * k * Z, up, 1e-4, np.inf) for k in range(2)}
    parallel, *wrong = (Relation(kind, (0, 1), EQUATIONS[kind]) for kind in ("parallel", "perpendicular", "coplanar"))
    settled, kept = settle(pieces, wrong, [parallel])
    assert kept == [parallel]
    assert placement(settled[1].primitive) == pytest.approx(placement(pieces[1].primitive))


def test_a_contradiction_is_left_over_and_the_less_strained_relation_met() -> None:
    primitives: dict[int, Primitive] = {0: Plane(Z, 0.0), 1: Plane(Z, 0.001)}
    points = plane_patch(np.random.default_rng(3), 50).points
    evidence = {0: Evidence(points, np.ones(50)), 1: Evidence(points, np.ones(50))}
    relations = [
        Relation("perpendicular", (0, 1), EQUATIONS["perpendicular"], strain=0.9),
        Relation("coplanar", (0, 1), EQUATIONS["coplanar"], strain=0.1),
    ]
    left = violations(satisfy(primitives, relations, evidence), relations)
    assert left[0] > 0.1


@pytest.mark.parametrize("seed", range(4))
def test_a_pin_as_thin_as_the_noise_stays_on_its_points_when_it_is_turned(seed: int) -> None:
    """Its normals turn by as much as its axis moves in units of the radius: slopes of the start lead uphill."""
    rng = np.random.default_rng(seed)
    angle, height = rng.uniform(-np.pi, np.pi, 40), rng.uniform(-0.3, 0.3, 40)
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    points = (0.003 + 0.003 * rng.uniform(-1.7, 1.7, (40, 1))) * radial + height[:, None] * Z
    normals = unit(radial + 0.05 * rng.normal(size=(40, 3)))
    fitted = oriented_fit("cylinder", None, points, normals, 0.003, 0.05)
    assert fitted is not None
    pieces = {
        0: piece(fitted, points, normals, 0.003, 0.05),
        1: piece(Plane(Z, 0.0), plane_patch(rng, 400).points, np.tile(Z, (400, 1)), 0.003, 0.05),
    }
    settled, kept = settle(pieces, [Relation("parallel", (1, 0), EQUATIONS["parallel"])])
    assert len(kept) == 1
    evidence = pieces[0].evidence
    assert evidence.chi_square(settled[0].primitive) - evidence.chi_square(fitted) < 9.0
    assert placement(settled[0].primitive)[6] == pytest.approx(0.003, abs=0.002)


def test_half_a_turn_leaves_a_plane_on_its_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tilted about the origin it would be far off them: what brings it back is shortened like what takes it away."""
    monkeypatch.setattr(solve_relations, "_STEPS", 1)
    monkeypatch.setattr(solve_relations, "_LAST_STEPS", 0)
    rng = np.random.default_rng(0)
    strip = np.column_stack([rng.uniform(4.9, 5.1, 50), rng.uniform(-0.1, 0.1, 50), np.zeros(50)])
    normal = np.array([np.sin(0.2), 0.0, np.cos(0.2)])
    pieces = {
        0: piece(Plane(Z, 1.0), plane_patch(rng, 400).points + Z, np.tile(Z, (400, 1)), 0.003, np.inf),
        1: piece(Plane(normal, float(normal @ strip.mean(axis=0))), strip, np.tile(Z, (50, 1)), 0.003, np.inf),
    }
    evidence = {k: entry.evidence for k, entry in pieces.items()}
    relation = Relation("parallel", (0, 1), EQUATIONS["parallel"])
    turned = satisfy({k: entry.primitive for k, entry in pieces.items()}, [relation], evidence)[1]
    assert 0.1 < np.arccos(placement(turned)[2]) < 0.19
    assert np.abs(turned.distance(strip.mean(axis=0)[None])) < 0.01


@pytest.mark.parametrize("angle", [0.05, np.inf])
def test_what_many_points_told_is_kept_where_relations_leave_it_open(angle: float) -> None:
    """Some points stand for all of them; their own best fit is another one."""
    rng = np.random.default_rng(0)
    sample = cylinder_patch(rng, 20_000)
    points = sample.points + 0.003 * rng.standard_normal((20_000, 1)) * sample.normals
    normals = unit(sample.normals + 0.05 * rng.normal(size=(20_000, 3)))
    fitted = fit("cylinder", points, normals, 0.003, angle)
    assert fitted is not None and isinstance(fitted[0], Cylinder)
    ground = Plane(Z, 0.0)
    pieces = {
        0: piece(fitted[0], points, normals, 0.003, angle),
        1: piece(ground, plane_patch(rng, 400).points, np.tile(Z, (400, 1)), 0.003, angle),
    }
    settled, kept = settle(pieces, [Relation("parallel", (1, 0), EQUATIONS["parallel"])])
    assert len(kept) == 1
    assert placement(settled[0].primitive)[6] == pytest.approx(fitted[0].radius, abs=0.003 / np.sqrt(20_000) / 5)
    alone = piece(fitted[0], points, normals, 0.003, angle, likeness=0.0)
    assert 0.003 / np.sqrt(20_000) < alone.spread(slice(4, 5)) < 5e-5  # what nobody sees allowed for
