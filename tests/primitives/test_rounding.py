"""Dimensions become multiples of the step where the points allow it, and only there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.torus import Torus
from sed2cad.regularize import Constraint, regularize
from tests.primitives.measured import UNTRACED, face, fitted_part, hole, placed
from tests.primitives.patches import Sample, cone_patch, cylinder_patch, line_distance, random_rotation, torus_patch

NOISE = 5e-4


def rounded(
    faces: list[Sample], step: float | None, seed: int = 0, noise: float = NOISE
) -> tuple[list[Primitive], list[Constraint]]:
    """The primitives, and what was rounded, in some pose."""
    rng = np.random.default_rng(seed)
    fitted, scan = fitted_part(faces, noise, rng, random_rotation(rng))
    result, constraints = regularize(scan, fitted, UNTRACED, step)
    assert [type(a.primitive) for a in result] == [type(f.truth) for f in faces]
    return [patch.primitive for patch in result], [c for c in constraints if c.kind == "rounded"]


def bore_of(radius: float) -> float:
    rng = np.random.default_rng(1)
    bore = rounded([hole(rng, (0, 0, 0), radius)], 0.01)[0][0]
    assert isinstance(bore, Cylinder)
    return bore.radius


def test_a_radius_on_the_grid_becomes_exact_and_others_stay() -> None:
    """300 points with noise 5e-4 know a radius to about 1e-4."""
    assert bore_of(0.10003) == pytest.approx(0.1, abs=1e-11)
    assert bore_of(0.105) == pytest.approx(0.105, abs=4e-4)
    assert abs(bore_of(0.102) - 0.1) > 1e-3


def test_what_could_be_any_of_several_multiples_stays() -> None:
    """An arc of 40 degrees knows its radius to 1e-3 at best: 0.1 is on the grid of 2e-4, but so is much else."""
    rng = np.random.default_rng(3)
    arc = cylinder_patch(rng, 200, 0.1, 0.3, 40.0)
    assert rounded([arc], 2e-4)[1] == []
    assert [c.after for c in rounded([arc], 0.05)[1]] == [pytest.approx(0.1)]


def test_the_change_is_told() -> None:
    rng = np.random.default_rng(1)
    (told,) = rounded([hole(rng, (0, 0, 0), 0.1)], 0.01)[1]
    assert told.measure == "radius" and told.patches == (0,)
    assert told.after == pytest.approx(0.1, abs=1e-15) and 1e-7 < abs(told.before - 0.1) < 4e-4
    assert told.residual == pytest.approx(abs(told.before - told.after), abs=1e-9)
    assert rounded([hole(rng, (0, 0, 0), 0.1)], None)[1] == []


def test_angles_and_the_radii_of_a_torus() -> None:
    rng = np.random.default_rng(2)
    faces = [
        placed(cone_patch(rng, 400, 30.0), (0, 0, 1), (0, 0, 0)),
        placed(cone_patch(rng, 400, 31.25), (1, 0, 0), (0, 1, 0)),
        placed(torus_patch(rng, 400, 0.2, 0.05), (0, 1, 0), (0, 0, 1)),
    ]
    (cone, other, torus), _ = rounded(faces, 0.01, noise=2e-4)
    assert isinstance(cone, Cone) and isinstance(other, Cone) and isinstance(torus, Torus)
    assert np.degrees(cone.half_angle) == pytest.approx(30, abs=1e-9)
    assert np.degrees(other.half_angle) == pytest.approx(31.25, abs=0.1)
    assert (torus.major_radius, torus.minor_radius) == pytest.approx((0.2, 0.05), abs=1e-10)


def block(rng: np.random.Generator) -> list[Sample]:
    """Faces x = 0, x = 0.4, x = 0.153, y = 0, one at 45 degrees, and holes at (0.1, 0.12), (0.3, 0.12)."""
    return [
        face(rng, (-1, 0, 0), (0, 0.2, 0)),
        face(rng, (1, 0, 0), (0.4, 0.2, 0)),
        face(rng, (1, 0, 0), (0.153, 0.3, 0)),
        face(rng, (0, -1, 0), (0.2, 0, 0)),
        face(rng, (1, 1, 0), (0.4, 0.4, 0)),
        hole(rng, (0.1, 0.12, 0), 0.03),
        hole(rng, (0.3, 0.12, 0), 0.03),
    ]


@pytest.mark.parametrize("seed", range(3))
def test_distances_of_planes_and_axes(seed: int) -> None:
    (left, right, odd, front, slant, a, b), told = rounded(block(np.random.default_rng(seed)), 0.02, seed)
    assert isinstance(left, Plane) and isinstance(right, Plane) and isinstance(front, Plane)
    assert isinstance(odd, Plane) and isinstance(slant, Plane)
    assert isinstance(a, Cylinder) and isinstance(b, Cylinder)
    assert right.offset + left.offset == pytest.approx(0.4, abs=1e-10)
    assert odd.offset + left.offset == pytest.approx(0.153, abs=3e-4)
    assert right.normal_vector @ slant.normal_vector == pytest.approx(np.sqrt(0.5), abs=1e-10)
    assert abs(left.distance(a.point[None])[0]) == pytest.approx(0.1, abs=1e-10)
    for bore in (a, b):
        assert abs(front.distance(bore.point[None])[0]) == pytest.approx(0.12, abs=1e-10)
    assert line_distance(b.point, a.axis, a.point) == pytest.approx(0.2, abs=1e-10)
    assert (a.radius, b.radius) == pytest.approx((b.radius, 0.03), abs=6e-4)
    assert len({(c.patches, c.measure) for c in told}) == len(told)


def test_axes_without_planes_keep_their_distance() -> None:
    rng = np.random.default_rng(4)
    (a, b), _ = rounded([hole(rng, (0, 0, 0), 0.05), hole(rng, (0.12, 0.16, 0), 0.05)], 0.01)
    assert isinstance(a, Cylinder) and isinstance(b, Cylinder)
    assert line_distance(b.point, a.axis, a.point) == pytest.approx(0.2, abs=1e-10)


def test_what_follows_from_the_rest_is_no_dimension_of_its_own() -> None:
    """Three parallel planes have two distances; equal radii are one radius."""
    rng = np.random.default_rng(5)
    faces = [face(rng, (0, 0, 1), (0, 0, height)) for height in (0.0, 0.1, 0.3)]
    assert len(rounded(faces, 0.05)[1]) == 2
    bores = [hole(rng, (0.1 * k, 0.33 * k * k, 0), 0.05) for k in range(3)]
    assert sum(c.measure == "radius" for c in rounded(bores, 0.01)[1]) == 1


def test_rounding_does_not_pull_a_face_off_its_points() -> None:
    rng = np.random.default_rng(6)
    faces = block(rng)
    fitted, scan = fitted_part(faces, NOISE, rng)
    for step in (0.001, 0.003, 0.01, 0.1):
        result, _ = regularize(scan, fitted, UNTRACED, step)
        assert all(a.rms < 1.1 * b.rms + 1e-4 for a, b in zip(result, fitted))


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 100))
def test_pose_and_order_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fitted, scan = fitted_part(block(np.random.default_rng(0)), NOISE, np.random.default_rng(1))
    turn, order = random_rotation(rng), rng.permutation(len(fitted))
    turned, moved = fitted_part(
        block(np.random.default_rng(0)), NOISE, np.random.default_rng(1), turn
    )
    shuffled: list[FittedPatch] = [turned[k] for k in order]
    first, second = regularize(scan, fitted, UNTRACED, 0.02)[0], regularize(moved, shuffled, UNTRACED, 0.02)[0]
    for place, k in enumerate(order):
        a, b = first[k].primitive, second[place].primitive
        if isinstance(a, Cylinder) and isinstance(b, Cylinder):
            assert a.radius == pytest.approx(b.radius, abs=1e-9)
            assert line_distance(turn @ a.point, b.axis, b.point) < 1e-5
        if isinstance(a, Plane) and isinstance(b, Plane):
            assert turn @ a.normal_vector == pytest.approx(b.normal_vector, abs=1e-5)
            assert a.offset == pytest.approx(b.offset, abs=1e-5)
