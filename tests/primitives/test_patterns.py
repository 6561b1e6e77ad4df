"""Bolt circles, grids, rows and symmetries: exact where they were meant, left alone where they were not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.images import MIRRORED, SHIFTED, TURNED, Image
from sed2cad.primitives.lattices import best_lattice
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.relations import placement, residual_jacobian, residuals
from sed2cad.primitives.vectors import unit
from sed2cad.regularize import Constraint, regularize
from tests.primitives.measured import UNTRACED, face, fitted_part, hole, placed
from tests.primitives.patches import Sample, cone_patch, line_distance, random_rotation, rotated
from tests.primitives.test_analytic import examples

NOISE = 3e-4
NONE = np.zeros((0, 2)), np.zeros(0)


def regular(
    faces: Sequence[Sample], seed: int = 0, step: float | None = None, noise: float = NOISE
) -> tuple[list[Primitive], list[Constraint]]:
    """The regularised primitives in some pose, and the constraints."""
    rng = np.random.default_rng(seed)
    fitted, scan = fitted_part(faces, noise, rng, random_rotation(rng))
    result, constraints = regularize(scan, fitted, UNTRACED, step)
    return [patch.primitive for patch in result], constraints


def of_kind(constraints: Sequence[Constraint], kind: str) -> list[Constraint]:
    return [constraint for constraint in constraints if constraint.kind == kind]


def axes(primitives: Sequence[Primitive]) -> Array:
    """Where the axes of parallel cylinders cross a plane (n, 3)."""
    cylinders = [primitive for primitive in primitives if isinstance(primitive, Cylinder)]
    axis = cylinders[0].axis
    return np.array([c.point - (c.point @ axis) * axis for c in cylinders])


def flange(rng: np.random.Generator, angles: Sequence[float], bore: bool = True) -> list[Sample]:
    """Holes of radius 0.03 at these angles on a circle of radius 0.3, a bore amid them, the face."""
    radians = np.radians(angles)
    holes = [hole(rng, (0.3 * np.cos(a), 0.3 * np.sin(a), 0), 0.03) for a in radians]
    return [*holes, *([hole(rng, (0, 0, 0), 0.1)] if bore else []), face(rng, (0, 0, 1), (0, 0, 0.05), 0.8)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("angles", [range(7, 367, 60), (7, 67, 127, 247, 307)], ids=["full", "gap"])
def test_a_flange_gets_equal_angles(angles: Sequence[float], seed: int) -> None:
    primitives, constraints = regular(flange(np.random.default_rng(seed), angles), seed)
    holes = primitives[: len(angles)]
    bore = primitives[len(angles)]
    assert isinstance(bore, Cylinder)
    spokes = axes([*holes, bore])
    spokes = spokes[:-1] - spokes[-1]
    assert np.linalg.norm(spokes, axis=1) == pytest.approx(np.linalg.norm(spokes[0]), abs=1e-9)
    cosines = unit(spokes) @ unit(spokes).T
    assert cosines == pytest.approx(np.cos(np.radians(np.subtract.outer(angles, angles))), abs=1e-9)
    assert len({round(hole.radius, 10) for hole in holes if isinstance(hole, Cylinder)}) == 1
    (told,) = of_kind(constraints, "bolt_circle")
    assert told.patches == tuple(range(len(angles))) and told.detail == "every 60 degrees"
    assert told.measure == "pitch_radius" and told.after == pytest.approx(0.3, abs=3e-4)
    (centred,) = of_kind(constraints, "centred")
    assert centred.patches == (len(angles), *range(len(angles)))


def test_a_bolt_circle_needs_no_bore_and_its_radius_can_be_rounded() -> None:
    primitives, constraints = regular(flange(np.random.default_rng(0), range(0, 360, 72), bore=False), step=0.05)
    places = axes(primitives)
    assert np.linalg.norm(places - places.mean(axis=0), axis=1) == pytest.approx(0.3, abs=1e-9)
    (told,) = (c for c in of_kind(constraints, "rounded") if c.measure == "pitch_radius")
    assert told.patches == (0, 1, 2, 3, 4) and told.after == pytest.approx(0.3, abs=1e-12)


def test_a_hole_that_is_off_by_more_than_its_uncertainty_stays() -> None:
    """At 7 degrees, not 9: 0.01 aside, a hundred standard deviations."""
    primitives, constraints = regular(flange(np.random.default_rng(1), (9, 67, 127, 187, 247, 307)))
    (told,) = of_kind(constraints, "bolt_circle")
    assert told.patches == (1, 2, 3, 4, 5)
    places = axes(primitives)
    spokes = unit(places[:2] - places[6])
    assert np.degrees(np.arccos(spokes[0] @ spokes[1])) == pytest.approx(58, abs=0.1)


def test_pins_and_other_holes_are_not_of_the_circle() -> None:
    faces = flange(np.random.default_rng(2), range(0, 360, 60))
    pin = Sample(faces[0].truth, faces[0].points, -faces[0].normals)
    wide = hole(np.random.default_rng(3), (-0.3, 0, 0), 0.04)
    told = of_kind(regular([pin, *faces[1:3], wide, *faces[4:]])[1], "bolt_circle")
    assert [c.patches for c in told] == [(1, 2, 4, 5)]


def test_conical_holes_repeat_too() -> None:
    rng = np.random.default_rng(4)
    sites = [(0.3 * np.cos(a), 0.3 * np.sin(a), 0.0) for a in np.radians(range(0, 360, 90))]
    faces = [placed(cone_patch(rng, 300, 40.0), (0, 0, 1), site) for site in sites]
    told = regular(faces)[1]
    assert {c.patches for c in told if c.kind in ("bolt_circle", "grid_pattern")} == {(0, 1, 2, 3)}


def plate(rng: np.random.Generator, sites: Sequence[tuple[float, float]]) -> list[Sample]:
    """Holes, and two sides at right angles."""
    holes = [hole(rng, (x, y, 0), 0.03) for x, y in sites]
    return [*holes, face(rng, (-1, 0, 0), (-0.1, 0.2, 0)), face(rng, (0, -1, 0), (0.2, -0.1, 0))]


@pytest.mark.parametrize("seed", range(3))
def test_a_grid_gets_equal_pitches_and_stands_square(seed: int) -> None:
    sites = [(0.2 * i, 0.15 * j) for i in range(3) for j in range(2)]
    primitives, constraints = regular(plate(np.random.default_rng(seed), sites), seed)
    places = axes(primitives).reshape(3, 2, 3)
    along, across = np.diff(places, axis=0).reshape(-1, 3), np.diff(places, axis=1).reshape(-1, 3)
    assert along == pytest.approx(np.tile(along[0], (4, 1)), abs=1e-9)
    assert across == pytest.approx(np.tile(across[0], (3, 1)), abs=1e-9)
    assert abs(along[0] @ across[0]) < 1e-10
    side = primitives[6]
    assert isinstance(side, Plane) and np.linalg.norm(np.cross(along[0], side.normal_vector)) < 1e-9
    pitches = {c.after: c.patches for c in of_kind(constraints, "grid_pattern")}
    assert sorted(pitches) == pytest.approx([0.15, 0.2], abs=3e-4)
    assert set(pitches.values()) == {tuple(range(6))} and len(of_kind(constraints, "aligned")) == 2


def test_a_row_with_a_gap_gets_one_pitch() -> None:
    faces = [hole(np.random.default_rng(5), (0.1 * k, 0.03 * k, 0), 0.02) for k in (0, 1, 2, 4)]
    primitives, constraints = regular(faces, step=0.0001)
    steps = np.diff(axes(primitives), axis=0)
    assert steps == pytest.approx(np.outer([1, 1, 2], steps[0]), abs=1e-9)
    (told,) = of_kind(constraints, "linear_pattern")
    assert told.measure == "pitch" and told.after == pytest.approx(np.hypot(0.1, 0.03), abs=2e-4)


def bracket(rng: np.random.Generator, lean: float = 0.0) -> list[Sample]:
    """Two sides, two slopes, two holes, one hole and one slot symmetric about x = 0.1; `lean` turns one slope."""
    slope = np.radians(30 + lean)
    return [
        face(rng, (-1, 0, 0), (-0.2, 0, 0)),
        face(rng, (1, 0, 0), (0.4, 0, 0)),
        face(rng, (-np.sin(0.5236), 0, np.cos(0.5236)), (-0.1, 0, 0.3), 0.2),
        face(rng, (np.sin(slope), 0, np.cos(slope)), (0.3, 0, 0.3), 0.2),
        hole(rng, (-0.05, 0.13, 0), 0.03),
        hole(rng, (0.25, 0.13, 0), 0.03),
        hole(rng, (0.1, -0.06, 0), 0.05),
        face(rng, (1, 0, 0), (0.04, -0.1, 0.2), 0.1),
        face(rng, (-1, 0, 0), (0.16, -0.1, 0.2), 0.1),
    ]


@pytest.mark.parametrize("seed", range(3))
def test_a_mirrored_bracket_becomes_symmetric(seed: int) -> None:
    primitives, constraints = regular(bracket(np.random.default_rng(seed)), seed)
    left, right, _, _, a, b, middle, _, _ = primitives
    assert isinstance(left, Plane) and isinstance(right, Plane) and isinstance(middle, Cylinder)
    assert isinstance(a, Cylinder) and isinstance(b, Cylinder)
    assert left.distance(middle.point[None]) == pytest.approx(right.distance(middle.point[None]), abs=1e-9)
    assert left.distance(a.point[None]) == pytest.approx(right.distance(b.point[None]), abs=1e-9)
    gap = axes([a, b])
    assert np.linalg.norm(np.cross(gap[0] - gap[1], left.normal_vector)) < 1e-9
    (told,) = of_kind(constraints, "symmetric")
    assert {0, 1, 4, 5, 6, 7, 8} <= set(told.patches)


def test_slopes_are_symmetric_where_they_are() -> None:
    for lean, expected in ((0.0, True), (3.0, False)):
        primitives, constraints = regular(bracket(np.random.default_rng(7), lean), 7)
        (told,) = of_kind(constraints, "symmetric")
        assert ({2, 3} <= set(told.patches)) == expected
        side, a, b = (placement(primitives[k])[:3] for k in (0, 2, 3))
        assert (abs(abs(side @ a) - abs(side @ b)) < 1e-9) == expected


@pytest.mark.parametrize("seed", range(5))
def test_nothing_repeats_at_random(seed: int) -> None:
    rng = np.random.default_rng(seed)
    holes = [hole(rng, (*rng.uniform(-0.4, 0.4, 2), 0), 0.02) for _ in range(8)]
    sides = [face(rng, (s, 0, 0), (x, 0, 0)) for s, x in zip((1, -1, 1, -1), rng.uniform(-0.5, 0.5, 4))]
    constraints = regular([*holes, *sides], seed)[1]
    kinds = ("bolt_circle", "linear_pattern", "grid_pattern", "symmetric")
    assert not [c for c in constraints if c.kind in kinds]


def test_random_places_have_no_lattice() -> None:
    """Expected: one in a thousand for each kind of pattern."""
    rng = np.random.default_rng(0)
    found = []
    for n, sigma in [(n, sigma) for n in (3, 4, 6, 10) for sigma in (1e-5, 3e-4, 1e-3) for _ in range(15)]:
        places, centre = rng.uniform(-0.5, 0.5, (n, 2)), rng.uniform(-0.1, 0.1, (1, 2))
        found.append(best_lattice(places, np.full(n, sigma), centre, np.full(1, sigma)))
    assert sum(lattice is not None for lattice in found) <= 1


@settings(max_examples=30, deadline=None)
@given(turn=st.floats(0, 6.28), count=st.integers(3, 12), seed=st.integers(0, 99))
def test_a_lattice_is_found_in_any_pose_and_order(turn: float, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    order = rng.permutation(count)
    angles = turn + 2 * np.pi * order / count
    circle = 0.3 * np.column_stack([np.cos(angles), np.sin(angles)]) + 1e-5 * rng.normal(size=(count, 2))
    found = best_lattice(circle + 0.1, np.full(count, 1e-5), *NONE)
    assert found is not None and len(found.members) == count
    row = order[:, None] * 0.07 * np.array([np.cos(turn), np.sin(turn)])
    found = best_lattice(row, np.full(count, 1e-5), *NONE)
    assert found is not None and len(found.members) == count and found.pitch.shape == (1, 2)
    assert np.linalg.norm(found.pitch) == pytest.approx(0.07, abs=1e-4)


AXIS, PITCH, MIDDLE = Cylinder(unit(np.array([1.0, 2, 2])), np.array([0.1, 0, 0.2]), 0.3), 0.37, 0.11


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_images_are_images(primitive: Primitive) -> None:
    """Turned by 0.7 about the axis, shifted by 3 radii along it, mirrored in a plane across it."""
    k, (x, y, z) = AXIS.axis, AXIS.axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + np.sin(0.7) * cross + (1 - np.cos(0.7)) * cross @ cross
    flip = np.eye(3) - 2 * np.outer(k, k)
    cases: list[tuple[Image, Primitive, float, Primitive]] = [
        (TURNED[primitive.kind], AXIS, 0.7, rotated(primitive, turn, AXIS.point - turn @ AXIS.point)),
        (SHIFTED[primitive.kind], AXIS, 3.0, rotated(primitive, np.eye(3), 0.9 * k)),
        (MIRRORED[primitive.kind], Plane(k, MIDDLE), 1.0, rotated(primitive, flip, 2 * MIDDLE * k)),
    ]
    for equation, datum, number, image in cases:
        sides = [placement(p)[None] for p in (primitive, image, datum)]
        assert residuals(equation, *sides, np.array([number])) == pytest.approx(0, abs=1e-12)
        if number != 1.0:
            assert np.abs(residuals(equation, *sides, np.array([number + 0.1]))).max() > 1e-3
        else:
            sides[2] = placement(Plane(k, MIDDLE + 0.1))[None]
            assert np.abs(residuals(equation, *sides, np.array([number]))).max() > 1e-3


@pytest.mark.parametrize("equation", [TURNED["cone"], SHIFTED["plane"], MIRRORED["torus"], MIRRORED["plane"]])
def test_their_complex_step_is_the_derivative(equation: Image) -> None:
    rng, step, number = np.random.default_rng(1), 1e-6, np.array([0.7])
    numbers = rng.uniform(0.3, 1.2, (1, 24))

    def value(numbers: Array) -> Array:
        return residuals(equation, *np.split(numbers, 3, axis=1), number)[0]

    columns = [(value(numbers + e) - value(numbers - e)) / (2 * step) for e in step * np.eye(24)]
    found = residual_jacobian(equation, *np.split(numbers, 3, axis=1), number)[0]
    assert found == pytest.approx(np.column_stack(columns), abs=1e-7)


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 100))
def test_pose_and_order_do_not_matter(seed: int) -> None:
    faces = bracket(np.random.default_rng(0)) + flange(np.random.default_rng(0), range(0, 360, 60))[:7]
    rng = np.random.default_rng(seed)
    turn, order = random_rotation(rng), rng.permutation(len(faces))
    (fitted, scan), (turned, moved) = (fitted_part(faces, NOISE, np.random.default_rng(1), t) for t in (None, turn))
    (first, told), (second, told_turned) = (
        regularize(scan, fitted, UNTRACED), regularize(moved, [turned[k] for k in order], UNTRACED)
    )
    for place, k in enumerate(order):
        a, b = first[k].primitive, second[place].primitive
        assert b.kind == a.kind
        if isinstance(a, Cylinder) and isinstance(b, Cylinder):
            assert line_distance(turn @ a.point, b.axis, b.point) < 1e-4
    patterns = {(c.kind, frozenset(c.patches)) for c in told if c.measure}
    assert patterns == {(c.kind, frozenset(int(order[k]) for k in c.patches)) for c in told_turned if c.measure}
