"""The freeform patch: distance, exact control net, fit over a plane and about an axis."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from sed2cad.primitives.base import Array
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.tensor_patch import DEGREE
from sed2cad.primitives.vectors import unit
from tests.primitives.patches import random_rotation


def wave(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points and normals of z = 0.1 sin 6x cos 5y."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.3, 0.3, (2, count))
    slope_x, slope_y = 0.6 * np.cos(6 * x) * np.cos(5 * y), -0.5 * np.sin(6 * x) * np.sin(5 * y)
    normals = unit(np.column_stack([-slope_x, -slope_y, np.ones(count)]))
    return np.column_stack([x, y, 0.1 * np.sin(6 * x) * np.cos(5 * y)]), normals


def lobes(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points and normals of the tube r = 0.2 + 0.03 cos 3u."""
    rng = np.random.default_rng(seed)
    u, z = rng.uniform(-np.pi, np.pi, count), rng.uniform(0, 0.5, count)
    radius, slope = 0.2 + 0.03 * np.cos(3 * u), -0.09 * np.sin(3 * u)
    radial = np.column_stack([np.cos(u), np.sin(u), 0 * u])
    around = np.column_stack([-np.sin(u), np.cos(u), 0 * u])
    points = radius[:, None] * radial + z[:, None] * [0, 0, 1]
    return points, unit(radial - (slope / radius)[:, None] * around)


@pytest.fixture(scope="module")
def surface() -> BSplineSurface:
    found = fit_bspline(*wave(800))
    assert found is not None
    return found


def test_a_wave_is_a_height_field(surface: BSplineSurface) -> None:
    points, normals = wave(300, seed=1)
    assert surface.base == "plane"
    assert np.sqrt(np.mean(surface.distance(points) ** 2)) < 5e-5
    assert np.einsum("ij,ij->i", surface.normal(points), normals).min() > 0.999


def test_the_distance_is_that_to_the_nearest_point(surface: BSplineSurface) -> None:
    points, normals = wave(200, seed=2)
    for height in (0.03, -0.03):
        assert surface.distance(points + height * normals) == pytest.approx(height, abs=3e-4)
        feet = surface.project(points + height * normals)
        assert feet == pytest.approx(points, abs=2e-3)
        assert surface.distance(feet) == pytest.approx(0, abs=1e-9)


def test_beyond_the_knots_the_distance_is_that_to_the_border(surface: BSplineSurface) -> None:
    far = surface.origin + 10 * surface.frame[0]
    assert abs(surface.distance(far[None])[0]) > 9


def test_the_control_net_is_exact(surface: BSplineSurface) -> None:
    net, uv = surface.control_points(), np.array([[0.05, -0.1], [-0.2, 0.13]])
    for parameters, point in zip(uv, surface.at(uv)):
        along_u = BSpline(surface.knots_u, net, DEGREE)(parameters[0])
        assert BSpline(surface.knots_v, along_u, DEGREE)(parameters[1]) == pytest.approx(point, abs=1e-14)


def test_a_lobed_tube_is_periodic() -> None:
    tube = fit_bspline(*lobes(900))
    assert tube is not None and tube.base == "cylinder"
    points, normals = lobes(300, seed=1)
    assert np.sqrt(np.mean(tube.distance(points) ** 2)) < 1e-4
    assert np.einsum("ij,ij->i", tube.normal(points), normals).min() > 0.99
    seam = np.array([[-np.pi, 0.0], [np.pi, 0.0]])
    assert np.ptp(tube.at(seam), axis=0) == pytest.approx(0, abs=1e-12)
    with pytest.raises(ValueError):
        tube.control_points()


def test_noise_is_smoothed_not_followed() -> None:
    points, normals = wave(800)
    noisy = points + 0.002 * np.random.default_rng(0).normal(size=(800, 1)) * normals
    found = fit_bspline(noisy, normals, noise=0.002)
    assert found is not None
    assert np.sqrt(np.mean(found.distance(points) ** 2)) < 0.001


def test_the_fit_moves_and_scales_with_its_points() -> None:
    points, normals = wave(300)
    rng = np.random.default_rng(5)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    for scale in (1.0, 3.0):
        found = fit_bspline(scale * points @ turn.T + shift, normals @ turn.T)
        assert found is not None
        assert np.sqrt(np.mean(found.distance(scale * points @ turn.T + shift) ** 2)) < 1e-4 * scale


def test_scaled_and_round_trip(surface: BSplineSurface) -> None:
    tube = fit_bspline(*lobes(300))
    assert tube is not None
    for patch, points in ((surface, wave(50)[0]), (tube, lobes(50)[0])):
        points = points + 0.01
        larger = patch.scaled(3.0, np.array([1.0, 2.0, 3.0]))
        expected = 3 * patch.distance(points)
        assert larger.distance(3 * points + [1, 2, 3]) == pytest.approx(expected, abs=1e-9)
        again = BSplineSurface.from_parameters(patch.parameters())
        assert again.distance(points) == pytest.approx(patch.distance(points), abs=1e-12)


def test_damaged_parameters_are_refused(surface: BSplineSurface) -> None:
    parameters = surface.parameters()
    for name, value in (("base", "ball"), ("knots_u", [0, 1]), ("heights", None), ("x_axis", [0, 0, 0])):
        with pytest.raises(ValueError):
            BSplineSurface.from_parameters({**parameters, name: value})
    assert surface.moved(np.zeros(0)) is surface
    assert surface.jacobian(np.zeros((4, 3))).shape == (4, 0)
