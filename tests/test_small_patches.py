"""Patches of a handful of points."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.fitting import fit_patches
from sed2cad.primitives.base import Patch
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Frame, Scan


def small_patches(kind: str, radius: float, rng: np.random.Generator, count: int = 20) -> tuple[Scan, list[Patch]]:
    """So many of 12 points, each a third around a cylinder, and a plane of 400 that tells how good the normals are."""
    turn, along = rng.uniform(-np.pi / 3, np.pi / 3, (count, 12)), rng.uniform(-0.02, 0.02, (count, 12))
    turn = turn * min(1.0, 0.02 / radius)
    normals = np.stack([0 * turn, np.sin(turn), np.cos(turn)], axis=2)
    middle = np.stack([along, 0 * along, -radius + 0 * along], axis=2)
    points = (middle + radius * normals + np.arange(count)[:, None, None]).reshape(-1, 3)
    flat = np.column_stack([rng.uniform(-0.3, 0.3, (400, 2)), np.full(400, -1.0)])
    points = np.vstack([points, flat])
    normals = np.vstack([normals.reshape(-1, 3), np.tile([0.0, 0.0, 1.0], (400, 1))])
    points += rng.normal(0, 3e-3, (len(points), 1)) * normals
    normals = unit(normals + rng.normal(0, 0.04, normals.shape))
    members = [*np.arange(12 * count).reshape(count, 12), np.arange(12 * count, len(points))]
    patches = [Patch(own, kind, np.ones(len(own), bool)) for own in members[:-1]]
    patches.append(Patch(members[-1], "plane", np.ones(400, bool)))
    return Scan(points, normals, None, Frame(np.zeros(3), 1.0), noise=3e-3, spacing=0.01), patches


@pytest.mark.parametrize(("kind", "radius", "simplest"), [
    ("cone", 1e3, "plane"), ("sphere", 1e3, "plane"), ("torus", 0.03, "cylinder"), ("cylinder", 0.03, "cylinder")
])
def test_a_handful_of_noisy_points_has_the_simplest_surface(kind: str, radius: float, simplest: str) -> None:
    """The kind of a patch may be chance; what the measured normals do tell stays."""
    scan, patches = small_patches(kind, radius, np.random.default_rng(0))
    found = [patch.primitive.kind for patch in fit_patches(scan, patches)[:-1]]
    assert found.count(simplest) >= 15
