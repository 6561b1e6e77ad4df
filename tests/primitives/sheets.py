"""Sheets that no base carries, with their normals in closed form."""

from __future__ import annotations

import numpy as np

from sed2cad.primitives.base import Array
from sed2cad.primitives.vectors import unit


def flank(count: int, seed: int = 0, turns: float = 2.5) -> tuple[Array, Array]:
    """A thread's flank: radius 0.2 .. 0.26, pitch 0.12, rising 0.3 with the radius."""
    rng = np.random.default_rng(seed)
    t, r = 2 * np.pi * turns * rng.uniform(0, 1, count), rng.uniform(0.2, 0.26, count)
    pitch = 0.12 / (2 * np.pi)
    points = np.column_stack([r * np.cos(t), r * np.sin(t), pitch * t + 0.3 * r])
    by_t = np.column_stack([-r * np.sin(t), r * np.cos(t), np.full(count, pitch)])
    by_r = np.column_stack([np.cos(t), np.sin(t), np.full(count, 0.3)])
    return points, unit(np.cross(by_r, by_t))


def hose(count: int, seed: int = 0) -> tuple[Array, Array]:
    """A tube of radius 0.05 around an S in the xy plane, y = 0.2 sin 4x, 0 <= x <= 1."""
    rng = np.random.default_rng(seed)
    x, angle = rng.uniform(0, 1, count), rng.uniform(-np.pi, np.pi, count)
    spine = np.column_stack([x, 0.2 * np.sin(4 * x), 0 * x])
    side = unit(np.column_stack([-0.8 * np.cos(4 * x), 1 + 0 * x, 0 * x]))
    normals = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * [0, 0, 1]
    return spine + 0.05 * normals, normals


def belt(count: int, seed: int = 0) -> tuple[Array, Array]:
    """A closed band, 0.1 wide along z, around a curve with a bight that no centre sees all of."""
    rng = np.random.default_rng(seed)
    t, z = rng.uniform(-np.pi, np.pi, count), rng.uniform(0, 0.1, count)
    x, y = 0.5 * np.cos(t), 0.3 * np.sin(t) - 0.3 * np.cos(2 * t)
    points = np.column_stack([x, y, z])
    along = np.column_stack([-0.5 * np.sin(t), 0.3 * np.cos(t) + 0.6 * np.sin(2 * t), 0 * t])
    return points, unit(np.cross(along, [0.0, 0, 1]))
