"""The kinds of patches, chosen again from their inner points."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.scan.noise import noise_level
from sed2cad.scan.normals import tangents
from sed2cad.segmentation.choose import Case, choose
from sed2cad.segmentation.energy import Tolerances
from sed2cad.segmentation.graph import neighbour_graph
from sed2cad.segmentation.level import Level
from sed2cad.segmentation.refine import State
from sed2cad.segmentation.segment import RIM
from sed2cad.segmentation.settle import settle
from tests.segmentation.shapes import Array


def countersink(pitch: float, noise: float, seed: int) -> tuple[Array, Array, Array]:
    """Points (n, 3), faces (n,) and outward normals (n, 3): a plane (0) around a cone (1) of 45 degrees and a bore
    (2), whose radius is 1."""
    rng = np.random.default_rng(seed)
    areas = np.pi * np.array([5.0**2 - 2.0**2, np.sqrt(2) * (2.0**2 - 1.0**2), 2 * 2.0])
    face = np.repeat([0, 1, 2], (areas / pitch**2).astype(int))
    angle, share = rng.uniform(0, 2 * np.pi, len(face)), rng.uniform(0, 1, len(face))
    outer, inner = np.array([5.0, 2.0, 1.0])[face], np.array([2.0, 1.0, 1.0])[face]
    radius = np.sqrt(inner**2 + share * (outer**2 - inner**2))
    height = np.choose(face, [0 * radius, radius - 2, -1 - 2 * share])
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    lean = np.array([0.0, np.sqrt(0.5), 1.0])[face]
    normals = np.column_stack([-lean[:, None] * around, np.sqrt(1 - lean**2)])
    points = np.column_stack([radius[:, None] * around, height])
    return points + noise * rng.normal(size=points.shape), face, normals


@pytest.mark.parametrize("seed", range(3))
def test_a_countersink_with_estimated_normals_is_a_cone(seed: int) -> None:
    """Its estimated normals turn towards those of the faces at both of its ends, as a torus would have it."""
    points, face, true = countersink(0.27, 0.035, seed)
    points = points / 10
    normals = tangents(points).normals
    normals *= np.sign(np.einsum("ij,ij->i", normals, true))[:, None]
    noise = noise_level(points, normals)
    tolerances = Tolerances(distance=noise)
    choices = [choose(Case.of(points[face == k], normals[face == k], tolerances)) for k in range(3)]
    state = State(face, tuple(choice for choice in choices if choice is not None))
    rows = np.arange(len(points))
    level = Level(rows, points, normals, neighbour_graph(points, normals, 0.0135, noise), rim=RIM)
    assert settle(level, state, tolerances, noise) == ["plane", "cone", "cylinder"]
