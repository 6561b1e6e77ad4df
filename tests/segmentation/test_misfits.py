"""Bores and tips of drills that a few points show."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sed2cad.fitting import fit_patches
from sed2cad.primitives.base import Patch
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.scan.scan import Frame, Scan
from sed2cad.segmentation.choose import Choice
from sed2cad.segmentation.energy import Tolerances
from sed2cad.segmentation.level import Level
from sed2cad.segmentation.misfits import with_misfits
from sed2cad.segmentation.refine import State

Array = NDArray[np.float64]
Z = np.array([0.0, 0.0, 1.0])
UNTURNED = np.eye(3)
RADIUS, DEEP = 0.015, 0.1
PLACES = np.array([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.0, 0.2, 0.0]])


def drilled(points: int, seed: int = 0, turn: Array = UNTURNED) -> tuple[Array, Array, NDArray[np.int64]]:
    """Three blind bores, 60 points on each, and so many on the 118 degree tip of each; which face each is on."""
    rng = np.random.default_rng(seed)
    found: list[tuple[Array, Array]] = []
    half = np.radians(59)
    for place in PLACES:
        angle, height = rng.uniform(0, 2 * np.pi, 60), rng.uniform(0, DEEP, 60)
        radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
        found.append((place + RADIUS * radial + height[:, None] * Z, -radial))
    for place in PLACES:
        angle, radius = rng.uniform(0, 2 * np.pi, points), RADIUS * np.sqrt(rng.uniform(0.1, 1, points))
        radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(points)])
        down = (RADIUS - radius) / np.tan(half)
        normals = np.sin(half) * Z - np.cos(half) * radial
        found.append((place + radius[:, None] * radial - down[:, None] * Z, normals))
    face = np.repeat(np.arange(6), [len(p) for p, _ in found])
    points_, normals_ = np.vstack([p for p, _ in found]), np.vstack([n for _, n in found])
    return points_ @ turn.T, normals_ @ turn.T, face


def level_of(points: Array, normals: Array) -> tuple[Level, Scan, Tolerances]:
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), 0.0, 0.006)
    tolerances = Tolerances(3e-4, 0.045)
    return Level.of(scan, np.arange(len(points)), tolerances), scan, tolerances


def bores(turn: Array, labels: NDArray[np.int64]) -> State:
    return State(labels, tuple(Choice(Cylinder(turn @ Z, turn @ place, RADIUS), -1, 0.0, 0.0) for place in PLACES))


@pytest.mark.parametrize("points, seed", [(3, 0), (3, 1), (5, 0), (9, 0)])
def test_tips_of_drills_are_cones_about_their_bores(points: int, seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    level, _, tolerances = level_of(*drilled(points, seed, turn)[:2])
    face = drilled(points, seed)[2]
    found = with_misfits(level, bores(turn, face % 3), tolerances)
    assert len(found.primitives) == 6
    for k in range(3):
        (name,) = set(found.labels[face == 3 + k])
        cone = found.primitives[name].primitive
        assert isinstance(cone, Cone)
        assert cone.half_angle == pytest.approx(np.radians(59), abs=1e-6)
        tip = turn @ (PLACES[k] - RADIUS / np.tan(np.radians(59)) * Z)
        assert np.abs(cone.apex - tip).max() < 1e-6


def test_two_points_tell_a_tip_where_the_others_are_known() -> None:
    points, normals, face = drilled(4)
    kept = (face != 5) | (np.cumsum(face == 5) <= 2)
    level, _, tolerances = level_of(points[kept], normals[kept])
    assert len(with_misfits(level, bores(UNTURNED, face[kept] % 3), tolerances).primitives) == 6
    alone = (face % 3 == 2) & kept
    level, _, tolerances = level_of(points[alone], normals[alone])
    state = State(np.zeros(alone.sum(), int), bores(UNTURNED, face).primitives[2:])
    assert len(with_misfits(level, state, tolerances).primitives) == 1


def test_points_that_nothing_explains_are_no_face() -> None:
    points, normals, face = drilled(5)
    wild = np.random.default_rng(3).standard_normal((15, 3))
    normals[face >= 3] = wild / np.linalg.norm(wild, axis=1)[:, None]
    level, _, tolerances = level_of(points, normals)
    assert len(with_misfits(level, bores(UNTURNED, face % 3), tolerances).primitives) == 3


def test_a_few_points_are_fitted_about_the_axis_beside_them() -> None:
    points, normals, face = drilled(2)
    kept = face % 3 == 0
    points, normals, face = points[kept], normals[kept], face[kept]
    _, scan, _ = level_of(points, normals)
    patches = [
        Patch(own := np.flatnonzero(face == name), kind, np.ones(len(own), bool))
        for name, kind in ((0, "cylinder"), (3, "cone"))
    ]
    bore, tip = (patch.primitive for patch in fit_patches(scan, patches))
    assert isinstance(bore, Cylinder) and isinstance(tip, Cone)
    assert abs(bore.axis @ tip.axis) == pytest.approx(1, abs=1e-9)
    assert tip.half_angle == pytest.approx(np.radians(59), abs=1e-3)
