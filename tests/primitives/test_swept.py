"""Extrusions and surfaces of revolution: distances, charts, fits, and when they are preferred."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sed2cad.fitting import fit_patches
from sed2cad.primitives.base import Array, FittedPatch, Patch, Primitive
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.profile import Profile
from sed2cad.primitives.profile_fit import Course, _basis, blank
from sed2cad.primitives.registry import primitive_class
from sed2cad.primitives.revolution import Revolution, reaching
from sed2cad.primitives.swept_align import align_swept
from sed2cad.primitives.swept_choice import Explained, swept_instead
from sed2cad.primitives.swept_fit import fit_extrusion, fit_revolution
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Frame, Scan
from tests.primitives.patches import Z, disturbed, random_rotation, torus_patch
from tests.primitives.test_bspline import wave

TILT = unit(np.array([0.3, -0.5, 0.8]))


def straight(closed: bool = False) -> Profile:
    """A profile along x from 0 to 1, or a round one of about radius 1."""
    if closed:
        angles = 2 * np.pi / 24 * np.arange(27)
        knots = 2 * np.pi / 24 * np.arange(-3, 28)
        return Profile(knots, 1.0115 * np.column_stack([np.cos(angles), np.sin(angles)]), True)
    return Profile(np.array([0.0] * 4 + [1.0] * 4), np.column_stack([np.arange(4) / 3, np.zeros(4)]), False)


def shifted(profile: Profile, x: float, y: float) -> Profile:
    return replace(profile, controls=profile.controls + np.array([x, y]))


def quarter_round(count: int) -> tuple[Array, Array]:
    """Points and normals of a quarter of a cylinder of radius 1."""
    angle, z = np.random.default_rng(0).uniform([0, 0], [1.5, 1], (count, 2)).T
    normals = np.column_stack([np.cos(angle), np.sin(angle), 0 * z])
    return normals + z[:, None] * Z, normals


def s_wall(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points and normals of y = 0.08 sin 9x, swept along z."""
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-0.3, 0.3, count), rng.uniform(-0.2, 0.2, count)
    slope = 0.72 * np.cos(9 * x)
    normals = unit(np.column_stack([-slope, np.ones(count), np.zeros(count)]))
    return np.column_stack([x, 0.08 * np.sin(9 * x), z]), normals


def oval(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points and outward normals of an elliptic tube."""
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(-0.2, 0.2, count)
    points = np.column_stack([0.3 * np.cos(angle), 0.15 * np.sin(angle), z])
    return points, unit(np.column_stack([0.15 * np.cos(angle), 0.3 * np.sin(angle), np.zeros(count)]))


def bell(count: int, seed: int = 0, turn: float = 2 * np.pi) -> tuple[Array, Array]:
    """Points and outward normals of r = 0.2 + 0.06 sin 12z."""
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(0, turn, count), rng.uniform(-0.2, 0.2, count)
    radius, slope = 0.2 + 0.06 * np.sin(12 * z), 0.72 * np.cos(12 * z)
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    return radius[:, None] * radial + z[:, None] * Z, unit(radial - slope[:, None] * Z)


def egg(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points and normals of the upper half of a spheroid, z = 0.3 sqrt(1 - (r / 0.2)^2)."""
    rng = np.random.default_rng(seed)
    angle, up = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, 1, count)
    radius = np.sqrt(1 - up**2)
    round_ = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    normals = unit(0.3 * radius[:, None] * round_ + 0.2 * up[:, None] * Z)
    return 0.2 * radius[:, None] * round_ + 0.3 * up[:, None] * Z, normals


def noisy(patch: tuple[Array, Array], noise: float, seed: int = 1) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    points, normals = patch
    return points + noise * rng.normal(size=(len(points), 1)) * normals, unit(
        normals + 0.04 * rng.normal(size=normals.shape)
    )


def kind_of(points: Array, normals: Array, noise: float) -> str:
    """What becomes of a freeform patch."""
    tensor = fit_bspline(points, normals, noise)
    assert tensor is not None
    found = swept_instead([Explained(tensor, tensor.heights.size, points, normals)], noise)
    return "bspline" if found is None else found[0].kind


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


SWEPT: list[Primitive] = [
    Extrusion(TILT, np.array([0.1, 0.2, 0.3]), unit(np.cross(TILT, Z)), straight()),
    Extrusion(TILT, np.array([0.1, 0.2, 0.3]), unit(np.cross(TILT, Z)), straight(closed=True)),
    Revolution(TILT, np.array([0.1, 0.2, 0.3]), shifted(straight(), 0.5, 0.0)),
    Revolution(TILT, np.zeros(3), shifted(straight(True), 3.0, 1.0)),
]


def test_distance_to_a_flat_wall_and_beyond_its_ends() -> None:
    wall = Extrusion(Z, np.zeros(3), np.array([1.0, 0.0, 0.0]), straight())
    points = np.array([[0.5, 0.3, 7.0], [0.5, -0.2, -9.0], [4.0, 4.0, 0.0]])
    assert wall.distance(points) == pytest.approx([-0.3, 0.2, -5.0])
    assert wall.normal(points[:1])[0] == pytest.approx([0, -1, 0])
    assert wall.project(points[:1])[0] == pytest.approx([0.5, 0.0, 7.0])


def test_a_round_profile_is_a_cylinder_and_a_ring_a_torus() -> None:
    points = np.random.default_rng(0).normal(size=(200, 3)) * 3
    tube = Extrusion(Z, np.zeros(3), np.array([1.0, 0.0, 0.0]), straight(closed=True))
    radius = np.hypot(points[:, 0], points[:, 1])
    assert tube.distance(points) == pytest.approx(radius - 1.0, abs=2e-4)
    ring = Revolution(Z, np.zeros(3), shifted(straight(True), 3.0, 0.0))
    assert ring.distance(points) == pytest.approx(np.hypot(radius - 3.0, points[:, 2]) - 1.0, abs=2e-4)


@pytest.mark.parametrize("surface", SWEPT)
def test_feet_normals_and_charts_agree(surface: Primitive) -> None:
    points = np.random.default_rng(3).normal(size=(60, 3))
    distance, normal = surface.distance_and_normal(points)
    feet = surface.project(points)
    assert np.linalg.norm(points - feet, axis=1) == pytest.approx(np.abs(distance), abs=1e-9)
    assert surface.distance(feet) == pytest.approx(0, abs=1e-9)
    near = feet + 1e-3 * surface.normal(feet)
    step = 1e-6
    numeric = [
        (surface.moved(d).distance(near) - surface.moved(-d).distance(near)) / (2 * step)
        for d in step * np.eye(surface.freedom)
    ]
    inside = np.abs(np.abs(np.einsum("ij,ij->i", points - feet, normal)) - np.abs(distance)) < 1e-9
    assert surface.jacobian(near)[inside] == pytest.approx(np.column_stack(numeric)[inside], abs=1e-5)


@pytest.mark.parametrize("surface", SWEPT)
def test_scaled_and_round_trip(surface: Primitive) -> None:
    points = np.random.default_rng(4).normal(size=(40, 3))
    larger = surface.scaled(3.0, np.array([1.0, 2.0, 3.0]))
    assert larger.distance(3 * points + [1, 2, 3]) == pytest.approx(3 * surface.distance(points), abs=1e-9)
    again = primitive_class(surface.kind).from_parameters(surface.parameters())
    assert again.distance(points) == pytest.approx(surface.distance(points), abs=1e-12)
    for name, value in (("profile", [[0, 1]]), ("knots", None), ("origin", [0, 0])):
        with pytest.raises(ValueError):
            type(surface).from_parameters({**surface.parameters(), name: value})


def test_a_profile_across_the_axis_is_refused() -> None:
    surface = Revolution(Z, np.zeros(3), straight())
    moved = [(a - 0.5, b) for a, b in surface.parameters()["profile"]]
    with pytest.raises(ValueError):
        Revolution.from_parameters({**surface.parameters(), "profile": moved})


def test_a_profile_goes_on_straight_or_round_and_stops_at_the_axis() -> None:
    longer = straight().longer(0.5, 0.25)
    assert longer.at(np.array(longer.ends)) == pytest.approx(np.array([[-0.5, 0.0], [1.25, 0.0]]))
    found = fit_extrusion(*quarter_round(600))
    assert found is not None
    grown = found.surface.profile.longer(0.3, 0.3, round=True)
    ends = found.surface.origin + grown.at(np.array(grown.ends)) @ found.surface.axes
    assert np.hypot(ends[:, 0], ends[:, 1]) == pytest.approx(1.0, abs=3e-3)
    assert straight(closed=True).bend(np.array([0.3, 2.0])) == pytest.approx(1.0, abs=1e-2)
    stopped = reaching(shifted(straight().reversed(), 0.1, 0.0), 0.5)
    assert stopped.at(np.array(stopped.ends))[:, 0] == pytest.approx([1.6, 0.0])


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_wall_and_a_tube_are_extrusions(noise: float) -> None:
    for patch, closed in ((s_wall, False), (oval, True)):
        points, normals = noisy(patch(900), noise) if noise else patch(900)
        found = fit_extrusion(points, normals, noise)
        assert found is not None and found.surface.profile.closed == closed
        angle = np.arccos(min(abs(float(found.surface.direction @ Z)), 1.0))
        assert angle < (4 * np.sqrt(np.trace(found.covariance)) if noise else 1e-5)
        assert rms(found.surface.distance(patch(400, seed=9)[0])) < (4e-4 if noise else 2e-5)
        assert kind_of(points, normals, noise) == "extrusion"


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("turn", [2 * np.pi, 1.5])
def test_a_bell_is_a_surface_of_revolution(noise: float, turn: float) -> None:
    points, normals = noisy(bell(900, turn=turn), noise) if noise else bell(900, turn=turn)
    found = fit_revolution(points, normals, noise)
    assert found is not None
    spread = np.sqrt(np.diag(found.covariance))
    assert np.arccos(min(abs(float(found.surface.axis @ Z)), 1.0)) < (5 * spread[:2].max() if noise else 1e-5)
    off = found.surface.origin - (found.surface.origin @ found.surface.axis) * found.surface.axis
    assert np.linalg.norm(off) < (6 * spread[2:].max() if noise else 1e-5)
    assert kind_of(points, normals, noise) == "revolution"


def test_an_egg_has_a_pole() -> None:
    found = fit_revolution(*egg(1200))
    assert found is not None
    assert sum(found.surface.poles()) == 1
    assert rms(found.surface.distance(egg(300, seed=5)[0])) < 1e-4


def test_outliers_are_ignored() -> None:
    points, normals = s_wall(1000)
    points = points.copy()
    points[::25] += 0.03 * normals[::25]
    found = fit_extrusion(points, normals)
    assert found is not None
    assert rms(found.surface.distance(s_wall(300, seed=4)[0])) < 1e-4


def test_the_fit_moves_and_scales_with_its_points() -> None:
    rng = np.random.default_rng(7)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    for patch, fitted in ((s_wall, fit_extrusion), (bell, fit_revolution)):
        for scale in (1.0, 5.0):
            points, normals = patch(800)
            found = fitted(scale * points @ turn.T + shift, normals @ turn.T)
            assert found is not None
            there = scale * patch(200, seed=2)[0] @ turn.T + shift
            assert rms(found.surface.distance(there)) < 3e-5 * scale


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_doubly_curved_patch_stays_freeform(noise: float) -> None:
    for seed in range(2):
        points, normals = noisy(wave(700, seed), noise, seed) if noise else wave(700, seed)
        assert kind_of(points, normals, noise) == "bspline"


def test_points_without_extent_make_no_swept_surface() -> None:
    t = np.linspace(0, 1.5, 90)
    curve = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    for fitted in (fit_extrusion, fit_revolution):
        for points in (curve, np.zeros((90, 3)), curve[:20]):
            found = fitted(points, curve[: len(points)])
            assert found is None or np.isfinite(found.surface.distance(points)).all()


@pytest.mark.parametrize("closed", [False, True])
def test_a_profile_of_few_points_has_its_basis(closed: bool) -> None:
    """A closed one of two spans would overlap itself: a patch of 34 points ended the whole reconstruction."""
    along = np.linspace(0, 1, 34)
    basis = _basis(blank(Course(along, 1.0, closed), 2), along)
    np.testing.assert_allclose(basis.sum(axis=1), 1)


def test_what_is_simpler_still_is_that() -> None:
    sample = disturbed(torus_patch(np.random.default_rng(0), 800, tube=(0.0, 150.0)), np.random.default_rng(1), 1e-3)
    assert kind_of(sample.points, sample.normals, 1e-3) == "torus"


def test_freeform_patches_of_a_scan_become_what_they_are() -> None:
    wall, wavy = noisy(s_wall(900), 5e-4), noisy(wave(900), 5e-4)
    points, normals = np.vstack([wall[0], wavy[0] + [0, 0, 0.5]]), np.vstack([wall[1], wavy[1]])
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), 5e-4, 0.01)
    halves = (np.arange(900), np.arange(900, 1800))
    fitted = fit_patches(scan, [Patch(own, "bspline", np.ones(900, bool)) for own in halves])
    assert [patch.primitive.kind for patch in fitted] == ["extrusion", "bspline"]
    assert fitted[0].covariance.shape == (2, 2) and fitted[0].rms < 7e-4
    assert fitted[0].sign == 1 or fitted[0].primitive.normal(points[:1])[0] @ normals[0] < 0


def test_parameters_can_be_changed() -> None:
    surface = SWEPT[0]
    changed = type(surface).from_parameters({**surface.parameters(), "direction": (0.0, 0.0, 1.0)})
    assert isinstance(changed, Extrusion)
    assert changed.axes @ Z == pytest.approx(0)
    assert replace(changed, origin=np.ones(3)).distance(np.ones((1, 3)))[0] == pytest.approx(0, abs=1e-12)


def test_a_wall_follows_the_floor_and_a_bell_the_bore() -> None:
    lean = unit(np.array([4e-4, -2e-4, 1.0]))
    wall, bell_ = fit_extrusion(*s_wall(600)), fit_revolution(*bell(600))
    assert wall is not None and bell_ is not None
    points = np.vstack([s_wall(600)[0], bell(600)[0]])
    own = np.arange(600)
    nothing = np.zeros(0, np.int64)

    def patch(primitive: Primitive, indices: NDArray[np.int64]) -> FittedPatch:
        spread = (2e-3) ** 2 * np.eye(primitive.freedom)
        return FittedPatch(Patch(indices, primitive.kind, indices >= 0), primitive, 1, 1e-3, spread)

    floor, bore = Plane(-lean, 0.0), Cylinder(lean, np.array([5e-5, 0.0, 0.0]), 0.1)
    fitted = [patch(floor, nothing), patch(wall.surface, own), patch(bore, nothing), patch(bell_.surface, own + 600)]
    patches, found = align_swept(fitted, points)
    assert [(f.kind, f.leader, f.index) for f in found] == [("parallel", 0, 1), ("coaxial", 2, 3)]
    turned, centred = patches[1].primitive, patches[3].primitive
    assert isinstance(turned, Extrusion) and isinstance(centred, Revolution)
    assert np.abs(np.cross(turned.direction, lean)).max() < 1e-12 and np.abs(turned.axes @ lean).max() < 1e-12
    assert np.abs(np.cross(centred.origin - bore.point, lean)).max() < 1e-12
    far = [patch(Plane(unit(np.array([0.1, 0.0, 1.0])), 0.0), nothing), fitted[1]]
    assert align_swept(far, points) == (far, [])


@pytest.mark.parametrize("seed", [418, 1265, 1987])
def test_scattered_points_have_no_surface_of_revolution(seed: int) -> None:
    """Turned about their axis they may all fall on one place of the profile."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(32, 3)) * [0.02, 0.01, 0.002]
    normals = np.tile([0, 0, 1.0], (32, 1)) + rng.normal(size=(32, 3)) * rng.choice([0.02, 0.1, 0.4])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    assert fit_revolution(points, normals, 0.00087) is None
