"""Fits: to the noise limit, with outliers, from few points; and the choice between kinds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sed2cad.fitting import fit, fit_patches, select, used_points
from sed2cad.primitives.base import Patch, Primitive
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Frame, Scan
from tests.primitives.patches import (
    Sample,
    Z,
    axis_angle,
    cone_patch,
    cylinder_patch,
    disturbed,
    line_distance,
    plane_patch,
    random_rotation,
    sphere_patch,
    torus_patch,
)
from tests.primitives.test_bspline import wave


def sample(kind: str, rng: np.random.Generator, count: int) -> Sample:
    if kind == "plane":
        return plane_patch(rng, count)
    if kind == "cylinder":
        return cylinder_patch(rng, count, arc=120)
    if kind == "cone":
        return cone_patch(rng, count, arc=180)
    if kind == "sphere":
        return sphere_patch(rng, count, cap=60)
    return torus_patch(rng, count, arc=90, tube=(0, 90), minor=0.03, major=0.1)


KINDS = ["plane", "cylinder", "cone", "sphere", "torus"]


def fitted(kind: str, patch: Sample, noise: float) -> Primitive:
    found = fit(kind, patch.points, patch.normals, noise)
    assert found is not None
    return found[0]


def off_truth(primitive: Primitive, patch: Sample) -> float:
    """Root mean square distance of the true surface, where it was sampled, from the fit."""
    return float(np.sqrt(np.mean(primitive.distance(patch.truth.project(patch.points)) ** 2)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [12, 30, 200])
def test_exact_points_give_the_exact_primitive(kind: str, count: int) -> None:
    rng = np.random.default_rng(count)
    patch = disturbed(sample(kind, rng, count), rng, 0.0)
    found = fit(kind, patch.points, patch.normals, 0.0)
    assert found is not None
    assert off_truth(found[0], patch) < 1e-7
    assert found[1] < 1e-7
    assert found[2].shape == (found[0].freedom,) * 2


@pytest.mark.parametrize("kind", KINDS)
def test_noise_and_tilted_normals_do_not_matter_much(kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        patch = disturbed(sample(kind, rng, 200), rng, 1e-3, normal_noise=6)
        assert off_truth(fitted(kind, patch, 1e-3), patch) < 5e-4


@pytest.mark.parametrize("kind", KINDS)
def test_one_point_in_ten_may_belong_elsewhere(kind: str) -> None:
    rng = np.random.default_rng(2)
    patch = disturbed(sample(kind, rng, 200), rng, 2e-4, normal_noise=3)
    points = patch.points.copy()
    points[:20] += rng.normal(size=(20, 3)) * 0.02
    found = fit(kind, points, patch.normals, 2e-4)
    assert found is not None
    assert off_truth(found[0], Sample(patch.truth, patch.points[20:], patch.normals[20:])) < 2e-4


@pytest.mark.parametrize("kind", KINDS)
def test_one_point_in_five_may_lie_anywhere(kind: str) -> None:
    """Least squares starts are far off, the points that fit best lead to better ones."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        patch = disturbed(sample(kind, rng, 150), rng, 1e-4, normal_noise=5)
        points, normals, wrong = patch.points.copy(), patch.normals.copy(), np.arange(150) < 30
        points[wrong] = rng.uniform(points.min(axis=0) - 0.05, points.max(axis=0) + 0.05, (30, 3))
        normals[wrong] = unit(rng.normal(size=(30, 3)))
        found = fit(kind, points, normals, 1e-4)
        assert found is not None
        assert off_truth(found[0], Sample(patch.truth, patch.points[~wrong], patch.normals[~wrong])) < 1e-4


def test_the_fillet_of_a_short_arc_is_followed_down_its_valley() -> None:
    rng = np.random.default_rng(4)
    patch = disturbed(torus_patch(rng, 500, major=0.35, minor=0.15, arc=45, tube=(0, 90)), rng, 2e-4, normal_noise=5)
    assert off_truth(fitted("torus", patch, 2e-4), patch) < 3 * 2e-4 * np.sqrt(7 / 500)


def test_a_tube_that_is_hardly_bent_has_its_curvature() -> None:
    """The centre is 20 lengths away: its chart alone would take hundreds of steps."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        patch = torus_patch(rng, 300, major=10.0, minor=0.15, arc=3.4, tube=(-90, 90))
        patch = Sample(patch.truth, patch.points - [10.0, 0.0, 0.0], patch.normals)
        patch = Sample(Torus(Z, np.array([-10.0, 0.0, 0.0]), 10.0, 0.15), patch.points, patch.normals)
        patch = disturbed(patch, rng, 5e-4, normal_noise=5)
        assert off_truth(fitted("torus", patch, 5e-4), patch) < 2 * 5e-4 * np.sqrt(7 / 300)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.3, 3))
def test_fits_move_scale_and_shuffle_with_their_points(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    turn, shift, order = random_rotation(rng), rng.uniform(-1, 1, 3), rng.permutation(80)
    for kind in KINDS:
        patch = disturbed(sample(kind, rng, 80), rng, 1e-4, normal_noise=2)
        points = (scale * patch.points @ turn.T + shift)[order]
        other = fit(kind, points, (patch.normals @ turn.T)[order], 1e-4 * scale)
        assert other is not None
        expected = scale * fitted(kind, patch, 1e-4).distance(patch.points)
        assert other[0].distance(scale * patch.points @ turn.T + shift) == pytest.approx(
            expected, abs=3e-5 * scale
        )


def test_a_full_cylinder_reaches_the_noise_limit() -> None:
    """500 points with sigma 1e-3: radius to 1e-3 / sqrt(500) = 4.5e-5, centre to sqrt(2) of that."""
    rng = np.random.default_rng(4)
    radii, shifts, tilts = [], [], []
    for _ in range(12):
        patch = disturbed(cylinder_patch(rng, 500), rng, 1e-3, normal_noise=5)
        cylinder, truth = fitted("cylinder", patch, 1e-3), patch.truth
        assert isinstance(cylinder, Cylinder) and isinstance(truth, Cylinder)
        radii.append(cylinder.radius - truth.radius)
        shifts.append(line_distance(cylinder.point, truth.axis, truth.point))
        tilts.append(axis_angle(cylinder.axis, truth.axis))
    assert np.std(radii) < 1.5 * 4.5e-5
    assert np.mean(shifts) < 1.5 * 9e-5
    assert np.mean(tilts) < 0.1


def test_an_arc_of_sixty_degrees_is_within_its_covariance() -> None:
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(12):
        patch = disturbed(cylinder_patch(rng, 200, arc=60), rng, 5e-4, normal_noise=5)
        found = fit("cylinder", patch.points, patch.normals, 5e-4)
        assert found is not None and isinstance(found[0], Cylinder) and isinstance(patch.truth, Cylinder)
        errors.append((found[0].radius - patch.truth.radius) / np.sqrt(found[2][4, 4]))
        assert abs(found[0].radius - patch.truth.radius) < 0.005
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 2


def test_twelve_points_give_a_plane_to_the_noise() -> None:
    rng = np.random.default_rng(6)
    patch = disturbed(plane_patch(rng, 12), rng, 1e-3, normal_noise=5)
    plane = fitted("plane", patch, 1e-3)
    assert isinstance(plane, Plane) and isinstance(patch.truth, Plane)
    assert axis_angle(plane.normal_vector, patch.truth.normal_vector) < 1.0
    assert plane.normal_vector @ patch.truth.normal_vector > 0


def test_normals_hold_a_narrow_strip_level() -> None:
    rng = np.random.default_rng(7)
    for _ in range(5):
        patch = disturbed(plane_patch(rng, 30, width=0.002), rng, 1e-3, normal_noise=3)
        plane = fitted("plane", patch, 1e-3)
        assert isinstance(plane, Plane) and isinstance(patch.truth, Plane)
        assert axis_angle(plane.normal_vector, patch.truth.normal_vector) < 5.0


def test_a_torus_fillet_has_its_radii() -> None:
    rng = np.random.default_rng(8)
    patch = disturbed(torus_patch(rng, 150, major=0.2, minor=0.03, tube=(90, 180)), rng, 2e-4, normal_noise=5)
    torus = fitted("torus", patch, 2e-4)
    assert isinstance(torus, Torus)
    assert torus.major_radius == pytest.approx(0.2, abs=3e-4)
    assert torus.minor_radius == pytest.approx(0.03, abs=3e-4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3])
def test_the_kind_is_found(kind: str, noise: float) -> None:
    rng = np.random.default_rng(9)
    for _ in range(4):
        patch = disturbed(sample(kind, rng, 150), rng, noise, normal_noise=4)
        chosen = select(patch.points, patch.normals, noise)
        assert chosen is not None and chosen.primitive.kind == kind


def test_a_cone_that_is_nearly_a_cylinder_is_told_apart_only_when_the_noise_allows() -> None:
    rng = np.random.default_rng(10)
    patch = cone_patch(rng, 200, half_angle=1.0, low=5.0, high=5.3)
    for noise, kind in ((1e-4, "cone"), (1e-2, "cylinder")):
        noisy = disturbed(patch, rng, noise, normal_noise=4)
        chosen = select(noisy.points, noisy.normals, noise)
        assert chosen is not None and chosen.primitive.kind == kind


def test_a_flat_cylinder_is_a_plane_and_a_chamfer_a_cone() -> None:
    rng = np.random.default_rng(11)
    flat = disturbed(cylinder_patch(rng, 300, radius=5.0, arc=2), rng, 1e-3, normal_noise=4)
    chosen = select(flat.points, flat.normals, 1e-3)
    assert chosen is not None and chosen.primitive.kind == "plane"
    chamfer = disturbed(cone_patch(rng, 60, half_angle=45, low=0.2, high=0.22), rng, 2e-4, normal_noise=4)
    chosen = select(chamfer.points, chamfer.normals, 2e-4)
    assert chosen is not None and isinstance(chosen.primitive, Cone)
    assert np.degrees(chosen.primitive.half_angle) == pytest.approx(45, abs=2)


def test_freeform_is_the_last_resort_and_can_be_forbidden() -> None:
    points, normals = wave(400)
    chosen = select(points, normals, 1e-4)
    assert chosen is not None and chosen.primitive.kind == "bspline"
    limited = select(points, normals, 1e-4, kinds=("plane", "cylinder"))
    assert limited is not None and limited.primitive.kind in ("plane", "cylinder")
    assert limited.cost > chosen.cost


def test_a_prior_tips_the_balance() -> None:
    rng = np.random.default_rng(12)
    patch = disturbed(cylinder_patch(rng, 60, radius=0.3, arc=40), rng, 3e-3, normal_noise=15)
    for favoured, other in (("plane", "cylinder"), ("cylinder", "plane")):
        prior = {favoured: 0.0, other: -400.0}
        chosen = select(patch.points, patch.normals, 3e-3, ("plane", "cylinder"), prior)
        assert chosen is not None and chosen.primitive.kind == favoured


def test_too_few_points_determine_nothing() -> None:
    points, normals = np.eye(3)[:2], np.eye(3)[:2]
    assert fit("sphere", points, normals, 0.0) is None
    assert fit_bspline(points, normals) is None


@pytest.mark.parametrize("kind", [*KINDS, "bspline"])
def test_degenerate_points_raise_nothing(kind: str) -> None:
    rng = np.random.default_rng(14)
    normals = np.tile([0.0, 0.0, 1.0], (20, 1))
    for points in (np.zeros((20, 3)), rng.uniform(size=(20, 1)) * [1.0, 2.0, 0.0]):
        for noise in (0.0, 1e-3):
            found = fit(kind, points, normals, noise)
            assert found is None or np.isfinite(found[0].distance(points)).all()
        assert select(points, normals, 1e-3) is not None


def bore_scan() -> tuple[Scan, list[Patch]]:
    """A bore with wrong points along its edge, and a single point."""
    rng = np.random.default_rng(13)
    patch = cylinder_patch(rng, 200)
    points, normals = patch.points.copy(), -patch.normals
    edge = np.arange(200) >= 150
    points[edge] += 0.02 * normals[edge]
    frame = Frame(np.zeros(3), 1.0)
    scan = Scan(points, normals, None, frame, noise=1e-4, spacing=0.01)
    everything = Patch(np.arange(200), "cylinder", ~edge)
    return scan, [everything, Patch(np.array([3]), "torus", np.array([False]))]


def test_patches_are_fitted_without_their_edge_points_and_know_their_side() -> None:
    scan, patches = bore_scan()
    bore, point = fit_patches(scan, patches)
    assert isinstance(bore.primitive, Cylinder)
    assert bore.primitive.radius == pytest.approx(0.1, abs=1e-9)
    assert bore.sign == -1
    assert bore.rms < 1e-9
    assert len(used_points(patches[0])) == 150
    assert point.primitive.kind == "plane"


def test_all_points_of_a_narrow_ring_count_where_its_interior_lies_in_one_place() -> None:
    """A flat ring, nearly all of it edge: what its interior tells of the tilt is off by a degree."""
    rng = np.random.default_rng(0)
    turn = rng.uniform(0, 2 * np.pi, 600)
    points = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]) * rng.uniform(0.29, 0.31, (600, 1))
    points[:, 2] = rng.normal(0, 4e-4, 600)
    scan = Scan(points, np.tile([0.0, 0, 1], (600, 1)), None, Frame(np.zeros(3), 1.0), noise=4e-4, spacing=0.01)
    ring = Patch(np.arange(600), "plane", turn < 0.3)
    assert 12 < ring.interior.sum() < 50
    normal = fit_patches(scan, [ring])[0].primitive.normal(points[:1])[0]
    assert np.degrees(np.arccos(abs(normal[2]))) < 0.02


def strip_scan(radius: float, rng: np.random.Generator) -> tuple[Scan, Patch]:
    """A strip, 0.3 by 0.04, of a cylinder about an axis along it, with noise.

    Its normals err together, as estimated ones do, and bend at the long borders.
    """
    along, across = rng.uniform(-0.15, 0.15, 1500), rng.uniform(-0.02, 0.02, 1500)
    turn = across / radius
    points = np.column_stack([along, radius * np.sin(turn), radius * (np.cos(turn) - 1)])
    bent = turn + 0.03 * np.sin(60 * along) + 0.5 * np.sign(across) * np.clip((np.abs(across) - 0.014) / 0.006, 0, 1)
    normals = np.column_stack([np.zeros(1500), np.sin(bent), np.cos(bent)])
    points += rng.normal(0, 5e-4, (1500, 1)) * normals
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), noise=5e-4, spacing=2e-3)
    return scan, Patch(np.arange(1500), "cylinder", np.ones(1500, bool))


def test_normals_that_bend_at_the_borders_do_not_make_a_strip_round() -> None:
    rng = np.random.default_rng(0)
    for kind in ("cylinder", "cone", "torus"):
        scan, patch = strip_scan(1e6, rng)
        (found,) = fit_patches(scan, [Patch(patch.indices, kind, patch.interior)])
        assert (found.primitive.kind, found.patch.kind) == ("plane", "plane")
    scan, patch = strip_scan(0.1, rng)
    (found,) = fit_patches(scan, [patch])
    assert isinstance(found.primitive, Cylinder)
    assert found.primitive.radius == pytest.approx(0.1, rel=0.1)


def test_a_cone_that_is_flat_is_a_plane() -> None:
    """Its radius changes by less than anybody measures; the CAD kernel refuses such a cone."""
    rng = np.random.default_rng(0)
    flat = Cone(np.array([0.0, 0.0, 1.0]), np.array([-1.3, 0.0, 0.0]), np.pi / 2 - 1.6e-5)
    points = flat.project(np.column_stack([rng.uniform(-0.3, 0.3, (1200, 2)), np.zeros(1200)]))
    scan = Scan(points, flat.normal(points), None, Frame(np.zeros(3), 1.0), noise=0.0, spacing=0.01)
    (found,) = fit_patches(scan, [Patch(np.arange(1200), "cone", np.ones(1200, bool))])
    assert (found.primitive.kind, found.patch.kind) == ("plane", "plane")
    assert found.rms < 1e-5
