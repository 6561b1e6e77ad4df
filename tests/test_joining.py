"""Pieces of freeform faces become one again; faces that are explained stay what they are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sed2cad.fitting import fit_patches
from sed2cad.joining import joined
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Frame, Scan

Array = NDArray[np.float64]
NOISE = 2e-5


def waves(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points and normals (n, 3) of a wavy sheet."""
    x, y = rng.uniform(-0.4, 0.4, (2, count))
    points = np.column_stack([x, y, 0.04 * np.sin(5 * x) * np.cos(4 * y)])
    slope = np.column_stack([0.2 * np.cos(5 * x) * np.cos(4 * y), -0.16 * np.sin(5 * x) * np.sin(4 * y)])
    return points, unit(np.column_stack([-slope, np.ones(count)]))


def fillet(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Two planes at a right angle with a fillet of radius 0.1 between them, by length along the profile."""
    s, y = rng.uniform(-0.3, 0.3, count), rng.uniform(-0.3, 0.3, count)
    half = 0.1 * np.pi / 4
    turn = np.clip(s / 0.1, -np.pi / 4, np.pi / 4)
    beyond = s - np.clip(s, -half, half)
    normals = np.column_stack([np.sin(turn), np.zeros(count), np.cos(turn)])
    along = np.column_stack([np.cos(turn), np.zeros(count), -np.sin(turn)])
    return 0.1 * normals + beyond[:, None] * along + y[:, None] * [0, 1, 0], normals


def fitted_pieces(
    points: Array, normals: Array, piece: NDArray[np.int64], kinds: list[str]
) -> tuple[Scan, list[FittedPatch]]:
    rng = np.random.default_rng(1)
    noisy = points + NOISE * rng.normal(size=(len(points), 1)) * normals
    scan = Scan(noisy, normals, None, Frame(np.zeros(3), 1.0), NOISE, 0.01)
    inside = [np.flatnonzero(piece == k) for k in range(len(kinds))]
    return scan, fit_patches(scan, [Patch(own, k, np.ones(len(own), bool)) for own, k in zip(inside, kinds)])


@pytest.mark.parametrize("seed", [0, 1])
def test_a_sheet_cut_into_tori_is_one_skin(seed: int) -> None:
    points, normals = waves(3000, np.random.default_rng(seed))
    piece = (points[:, 0] > 0).astype(int) + 2 * (points[:, 1] > 0)
    scan, fitted = fitted_pieces(points, normals, piece, ["torus"] * 4)
    assert min(f.rms for f in fitted) > 5 * NOISE
    (whole,) = joined(scan, fitted)
    assert whole.primitive.freeform and whole.rms < 1.5 * NOISE
    assert sorted(whole.patch.indices) == list(range(3000))


def test_a_skin_does_not_swallow_the_planes_around_it() -> None:
    points, normals = waves(2000, np.random.default_rng(2))
    x, y = np.random.default_rng(3).uniform(-0.4, 0.4, (2, 1500))
    flat = np.column_stack([x, y + 0.8, np.full(1500, 0.04 * 0.1)])
    piece = np.r_[(points[:, 0] > 0).astype(int), np.full(1500, 2)]
    both = np.vstack([points, flat]), np.vstack([normals, np.tile([0.0, 0.0, 1.0], (1500, 1))])
    scan, fitted = fitted_pieces(*both, piece, ["torus", "torus", "plane"])
    found = joined(scan, fitted)
    assert [f.primitive.freeform for f in found] == [True, False]
    assert found[1].primitive.kind == "plane" and len(found[1].patch.indices) == 1500


def test_a_fillet_and_its_planes_stay_three() -> None:
    points, normals = fillet(3000, np.random.default_rng(0))
    piece = np.where(normals[:, 0] < -0.7071, 0, np.where(normals[:, 0] > 0.7071, 2, 1))
    scan, fitted = fitted_pieces(points, normals, piece, ["plane", "cylinder", "plane"])
    assert [f.primitive.kind for f in joined(scan, fitted)] == ["plane", "cylinder", "plane"]
