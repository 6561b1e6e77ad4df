"""Small noisy patches, whose normals know more than their points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.fitting import fit
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.oriented_fit import directions, normal_noise, oriented_fit
from sed2cad.primitives.refine import Directions, normal_jacobian, refine, uncertainty
from sed2cad.primitives.vectors import unit
from tests.primitives.patches import Sample, Z, cone_patch, cylinder_patch, plane_patch, sphere_patch, torus_patch

NOISE, ANGLE = 0.003, 0.035
AXIS = unit(np.array([1.0, 2.0, -0.5]))


def strip(seed: int, count: int = 25, radius: float = 0.015) -> tuple[NDArray, NDArray]:
    """A quarter of a cylinder about AXIS through 0, as long as it is wide, five times as thick as the noise."""
    rng = np.random.default_rng(seed)
    angle, height = rng.uniform(0, np.pi / 2, count), rng.uniform(-0.012, 0.012, count)
    x = unit(np.cross(AXIS, [0, 0, 1.0]))
    normals = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * np.cross(AXIS, x)
    points = (radius + NOISE * rng.normal(size=count))[:, None] * normals + height[:, None] * AXIS
    return points, unit(normals + ANGLE * rng.normal(size=(count, 3)))


def tilt(cylinder: Cylinder) -> float:
    return float(np.linalg.norm(np.cross(cylinder.axis, AXIS)))


def test_the_normals_tell_the_axis_of_a_small_patch() -> None:
    by_points, by_both = [], []
    for seed in range(20):
        points, normals = strip(seed)
        for angle, found in ((np.inf, by_points), (ANGLE, by_both)):
            result = fit("cylinder", points, normals, NOISE, angle)
            assert result is not None and isinstance(result[0], Cylinder)
            found.append(tilt(result[0]))
    assert np.median(by_both) < 3 * ANGLE / 5  # of 25 points, which see a quarter of the turn
    assert np.median(by_both) < 0.25 * np.median(by_points)


def test_the_covariance_is_honest() -> None:
    """Tilts of the axis over what the fit claims, squared: chi^2 of two degrees of freedom."""
    squares = []
    for seed in range(40):
        result = fit("cylinder", *strip(seed), NOISE, ANGLE)
        assert result is not None and isinstance(result[0], Cylinder)
        spread = np.trace(result[2][:2, :2])
        squares.append(2 * tilt(result[0]) ** 2 / spread)
    assert 0.7 < np.median(squares) / 1.386 < 2.0


def test_wide_patches_are_fitted_to_their_points_alone() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (200, 2)), 1e-4 * rng.normal(size=200)])
    normals = unit(np.array([0.05, 0.0, 1.0]) + 0.02 * rng.normal(size=(200, 3)))  # all of them wrong alike
    alone, both = fit("plane", points, normals, 1e-4), fit("plane", points, normals, 1e-4, 0.02)
    assert alone is not None and both is not None
    np.testing.assert_array_equal(alone[0].normal(points[:1]), both[0].normal(points[:1]))


def test_a_plane_needs_one_point_with_a_normal_and_no_other_kind_does() -> None:
    point, normal = np.array([[0.1, 0.2, 0.3]]), np.array([[0.0, 0.6, 0.8]])
    found = fit("plane", point, normal, NOISE, ANGLE)
    assert found is not None
    np.testing.assert_allclose(found[0].normal(point), normal, atol=1e-9)
    np.testing.assert_allclose(found[0].distance(point), 0, atol=1e-9)
    assert np.sqrt(found[2][0, 0]) == pytest.approx(ANGLE, rel=0.05)
    for kind in ("cylinder", "cone", "sphere", "torus"):
        assert fit(kind, point, normal, NOISE, ANGLE) is None


@pytest.mark.parametrize("make", [plane_patch, cylinder_patch, cone_patch, sphere_patch, torus_patch])
def test_normals_turn_as_their_jacobian_says(make: Callable[[np.random.Generator, int], Sample]) -> None:
    sample = make(np.random.default_rng(2), 30)
    truth, points = sample.truth, sample.points
    step = 1e-5 * np.random.default_rng(3).normal(size=truth.freedom)
    change = truth.moved(step).normal(points) - truth.normal(points)
    np.testing.assert_allclose(normal_jacobian(truth, points) @ step, change, atol=1e-7)


def test_a_sideways_error_says_little_near_an_axis() -> None:
    """On a rod as thin as the noise the gaps around it hardly count, those along it do."""
    rod = Cylinder(np.array([0.0, 0, 1]), np.zeros(3), NOISE)
    points = np.array([[NOISE, 0, 0]])
    whitening = Directions(np.array([[1.0, 0, 0]]), ANGLE, NOISE).whitening(rod, points)[0]
    around, along = np.linalg.norm(whitening @ [0, 1.0, 0]), np.linalg.norm(whitening @ [0, 0, 1.0])
    assert along == pytest.approx(NOISE / ANGLE)
    assert around < 0.1 * along


def test_rigid_motion_and_scale_move_the_fit_along() -> None:
    points, normals = strip(5)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    plain = oriented_fit("cylinder", None, points, normals, NOISE, ANGLE)
    moved = oriented_fit("cylinder", None, 2 * points @ turn.T + 0.3, normals @ turn.T, 2 * NOISE, ANGLE)
    assert isinstance(plain, Cylinder) and isinstance(moved, Cylinder)
    assert moved.radius == pytest.approx(2 * plain.radius, rel=1e-3)
    assert abs(moved.axis @ turn @ plain.axis) == pytest.approx(1, abs=1e-5)


def test_the_noise_of_normals_is_measured_on_the_patches() -> None:
    rng = np.random.default_rng(0)
    sample = sphere_patch(rng, 400)
    truth, points, normals = sample.truth, sample.points, sample.normals
    turned = unit(normals + 0.05 * rng.normal(size=(400, 3)))
    assert normal_noise([truth], [points], [turned]) == pytest.approx(0.05, rel=0.1)
    assert normal_noise([truth], [points], [-turned]) == pytest.approx(0.05, rel=0.1)
    assert normal_noise([], [], []) == np.inf


def test_normals_that_err_together_are_not_listened_to() -> None:
    """As estimated ones do: each is the mean of those around it."""
    rng = np.random.default_rng(0)
    sample = sphere_patch(rng, 400)
    turned = unit(sample.normals + 0.3 * rng.normal(size=(400, 3)))
    _, near = cKDTree(sample.points).query(sample.points, 16)
    estimated = unit(turned[near].mean(axis=1))
    assert np.isfinite(normal_noise([sample.truth], [sample.points], [turned]))
    assert normal_noise([sample.truth], [sample.points], [estimated]) == np.inf


def test_directions_narrow_what_the_points_leave_open() -> None:
    points, normals = strip(7)
    found = oriented_fit("cylinder", None, points, normals, NOISE, ANGLE)
    assert found is not None
    said = directions(found, points, normals, NOISE, ANGLE)
    alone, both = uncertainty(found, points, NOISE), uncertainty(found, points, NOISE, said)
    assert np.trace(both.covariance[:2, :2]) < 0.1 * np.trace(alone.covariance[:2, :2])
    again = refine(found, points, NOISE, 30, directions=said)
    assert tilt(again) == pytest.approx(tilt(found), abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_all_points_have_a_say(seed: int) -> None:
    """The radius of a thin rod, known to 1 % of the noise by its 10,000 points, not to 6 % by some of them."""
    rng = np.random.default_rng(seed)
    angle, count, radius, noise = rng.uniform(-np.pi, np.pi, 10_000), 10_000, 0.05, 0.01
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    points = (radius + noise * rng.standard_normal((count, 1))) * radial + rng.uniform(-0.5, 0.5, (count, 1)) * Z
    normals = unit(radial + 0.05 * rng.standard_normal((count, 3)))
    found = oriented_fit("cylinder", None, points, normals, noise, 0.05)
    assert isinstance(found, Cylinder)
    assert abs(found.radius - radius) < 4 * noise * np.sqrt(1 / count)
