"""A bracket measured with noise: what was meant to be square, coaxial, equal and tangent becomes so."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from sed2cad.fitting import fit_patches
from sed2cad.primitives.base import Array, FittedPatch, Patch
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.vectors import tangent_frame
from sed2cad.regularize import Constraint, regularize, tangent_pairs
from sed2cad.scan.scan import Frame, Scan
from sed2cad.topology.model import Chain, Region, Topology
from tests.primitives.patches import axis_angle, line_distance, random_rotation
from tests.primitives.test_bspline import wave

FLOOR, WALL, SIDE, FILLET, BORE_A, BORE_B, STEP = range(7)


def flat(rng: np.random.Generator, n: int, normal: Array, centre: Array, size: float) -> tuple[Array, Array]:
    spread = rng.uniform(-size / 2, size / 2, (n, 2)) @ np.stack(tangent_frame(normal))
    return centre + spread, np.tile(normal, (n, 1))


def round_(
    rng: np.random.Generator,
    n: int,
    axis: Array,
    point: Array,
    radius: float,
    height: float,
    arc: tuple,
    outward: int,
) -> tuple[Array, Array]:
    x, y = tangent_frame(axis)
    angle, along = np.radians(rng.uniform(*arc, n))[:, None], rng.uniform(-height / 2, height / 2, (n, 1))
    radial = np.cos(angle) * x + np.sin(angle) * y
    return point + radius * radial + along * axis, outward * radial


def bracket(noise: float, seed: int = 0, draft: float = 0.0) -> tuple[Scan, list[Patch], Topology]:
    """Floor z = 0, wall x = 0, a fillet of radius 0.05 between them along y, a side across y (tilted by
    `draft` degrees), two bores on one axis, a step level with the floor."""
    rng = np.random.default_rng(seed)
    x, y, z = np.eye(3)
    tilt = np.radians(draft)
    side = np.cos(tilt) * y + np.sin(tilt) * z
    frame_x, frame_y = tangent_frame(y)
    towards = np.degrees(np.arctan2(-(x + z) @ frame_y, -(x + z) @ frame_x))  # the middle of the fillet
    faces = [
        flat(rng, 400, z, np.array([0.25, 0.0, 0.0]), 0.4),
        flat(rng, 400, x, np.array([0.0, 0.0, 0.25]), 0.4),
        flat(rng, 300, side, np.array([0.2, 0.2, 0.2]), 0.3),
        round_(rng, 120, y, 0.05 * (x + z), 0.05, 0.4, (towards - 45, towards + 45), -1),
        round_(rng, 80, z, np.array([0.3, 0.05, -0.1]), 0.03, 0.1, (0, 360), -1),
        round_(rng, 60, z, np.array([0.3, 0.05, 0.4]), 0.0305, 0.05, (0, 360), -1),
        flat(rng, 60, z, np.array([0.7, 0.0, 0.0]), 0.15),
    ]
    turn = random_rotation(rng)
    points = np.concatenate([p + noise * n * rng.normal(size=(len(p), 1)) for p, n in faces]) @ turn.T
    normals = np.concatenate([n for _, n in faces]) @ turn.T
    ends = np.cumsum([len(p) for p, _ in faces])
    kinds = ["plane", "plane", "plane", "cylinder", "cylinder", "cylinder", "plane"]
    patches = [
        Patch(np.arange(end - len(p), end), kind, np.ones(len(p), bool))
        for (p, _), end, kind in zip(faces, ends, kinds)
    ]
    line = np.linspace(-0.2, 0.2, 9)[:, None] * y
    chains = tuple(
        Chain((line + start) @ turn.T, a, b, 0, 1)
        for start, a, b in (
            (0.05 * x, FLOOR, FILLET),
            (0.05 * z, FILLET, WALL),
            (0.4 * z + 0.2 * x, WALL, SIDE),
        )
    )
    regions = tuple(Region(k, (), np.zeros((0, 3)), 0.0, 0) for k in range(len(faces)))
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), noise, 0.01)
    return scan, patches, Topology(regions, chains, np.zeros((0, 3)), 0.0)


def regular(
    noise: float, seed: int = 0, draft: float = 0.0
) -> tuple[list[FittedPatch], list[Constraint], Scan]:
    scan, patches, topology = bracket(noise, seed, draft)
    fitted, constraints = regularize(scan, fit_patches(scan, patches), topology)
    return fitted, constraints, scan


def plane(patch: FittedPatch) -> Plane:
    assert isinstance(patch.primitive, Plane)
    return patch.primitive


def cylinder(patch: FittedPatch) -> Cylinder:
    assert isinstance(patch.primitive, Cylinder)
    return patch.primitive


@pytest.mark.parametrize("noise", [0.0, 5e-4, 2e-3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_bracket_becomes_exact(noise: float, seed: int) -> None:
    fitted, _, _ = regular(noise, seed)
    floor, wall, side = (plane(fitted[k]).normal_vector for k in (FLOOR, WALL, SIDE))
    fillet, a, b = (cylinder(fitted[k]) for k in (FILLET, BORE_A, BORE_B))
    for first, second in ((floor, wall), (floor, side), (wall, side)):
        assert abs(first @ second) < 1e-9
    assert axis_angle(a.axis, floor) < 1e-7 and axis_angle(b.axis, floor) < 1e-7
    assert line_distance(b.point, a.axis, a.point) < 1e-9
    assert axis_angle(fillet.axis, side) < 1e-7
    for flank in (FLOOR, WALL):
        assert abs(plane(fitted[flank]).distance(fillet.point[None])[0] - fillet.radius) < 1e-9
    step = plane(fitted[STEP])
    assert abs(step.offset - plane(fitted[FLOOR]).offset * (step.normal_vector @ floor)) < 1e-9


def test_it_also_gets_nearer_to_the_truth() -> None:
    before, after = [], []
    for seed in range(4):
        scan, patches, topology = bracket(2e-3, seed)
        clean = bracket(0.0, seed)[0].points
        rough = fit_patches(scan, patches)
        fine, _ = regularize(scan, rough, topology)
        for list_, errors in ((rough, before), (fine, after)):
            errors += [np.sqrt(np.mean(p.primitive.distance(clean[p.patch.indices]) ** 2)) for p in list_]
    assert np.mean(after) < 0.8 * np.mean(before)


def test_each_constraint_is_listed_with_what_it_changed() -> None:
    _, constraints, _ = regular(1e-3)
    count = Counter(constraint.kind for constraint in constraints)
    assert count["perpendicular"] == 3 and count["coaxial"] == 1 and count["tangent"] == 2
    assert count["coplanar"] == 1 and count["parallel"] == 4
    assert all(0 <= constraint.residual < 0.1 for constraint in constraints)
    assert any(constraint.residual > 1e-5 for constraint in constraints)


def test_on_a_clean_scan_a_draft_stays_and_radii_stay_different() -> None:
    """One degree of draft and bores of 0.03 and 0.0305 are meant; the noise would show if they were not."""
    fitted, constraints, _ = regular(2e-5, draft=1.0)
    floor, side = plane(fitted[FLOOR]).normal_vector, plane(fitted[SIDE]).normal_vector
    assert np.degrees(np.arcsin(abs(floor @ side))) == pytest.approx(1.0, abs=0.02)
    a, b = cylinder(fitted[BORE_A]), cylinder(fitted[BORE_B])
    assert b.radius - a.radius == pytest.approx(5e-4, abs=1e-4)
    assert not any(set(c.patches) == {FLOOR, SIDE} for c in constraints if c.kind != "tangent")


def test_a_false_tangency_is_dropped() -> None:
    """Told that floor and bore touch smoothly, it does not believe it."""
    scan, patches, topology = bracket(2e-4)
    fitted = fit_patches(scan, patches)
    rough = fitted[BORE_A].rms
    chain = Chain(fitted[BORE_A].primitive.project(scan.points[:5]), BORE_A, BORE_B, 0, 1)
    twisted = Topology(topology.regions, (*topology.chains, chain), topology.corners, 0.0)
    result, _ = regularize(scan, fitted, twisted)
    assert result[BORE_A].rms < 1.2 * rough + 1e-4


def test_tangent_pairs_are_those_whose_normals_agree() -> None:
    scan, patches, topology = bracket(1e-4)
    assert tangent_pairs(fit_patches(scan, patches), topology) == [(FLOOR, FILLET), (WALL, FILLET)]


def test_freeform_patches_and_lonely_ones_stay_as_they_are() -> None:
    points, normals = wave(300)
    surface = fit_bspline(points, normals)
    assert surface is not None
    patch = FittedPatch(
        Patch(np.arange(300), "bspline", np.ones(300, bool)), surface, 1, 0.0, np.zeros((0, 0))
    )
    nothing = Topology((), (), np.zeros((0, 3)), 0.0)
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), 0.0, 0.01)
    fitted, constraints = regularize(scan, [patch], nothing)
    assert fitted[0] is patch and not constraints
    assert regularize(scan, [], nothing) == ([], [])
