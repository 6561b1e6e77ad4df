"""Labelled clouds of simple solids, sampled in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.scan import Mesh

Array = NDArray[np.float64]


def box(size: tuple[float, float, float], count: int, seed: int = 0) -> tuple[Array, Array, NDArray[np.int64]]:
    """Points (n, 3), outward normals (n, 3), face number (n,) on a box around 0."""
    rng = np.random.default_rng(seed)
    extent = np.array(size) / 2
    area = np.repeat([extent[1] * extent[2], extent[0] * extent[2], extent[0] * extent[1]], 2)
    face = rng.choice(6, count, p=area / area.sum())
    points = rng.uniform(-1, 1, (count, 3)) * extent
    normals = np.zeros((count, 3))
    axis, side = face // 2, np.where(face % 2, 1.0, -1.0)
    points[np.arange(count), axis] = side * extent[axis]
    normals[np.arange(count), axis] = side
    return points, normals, face


def drum(radius: float, height: float, count: int, seed: int = 0) -> tuple[Array, Array, NDArray[np.int64]]:
    """A cylinder (0) with a lid (1) and a bottom (2)."""
    rng = np.random.default_rng(seed)
    area = np.array([2 * height, radius, radius])
    face = rng.choice(3, count, p=area / area.sum())
    angle = rng.uniform(0, 2 * np.pi, count)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    up = np.array([0.0, 0.0, 1.0])
    across = np.where(face == 0, radius, radius * np.sqrt(rng.uniform(0, 1, count)))
    level = np.select([face == 0, face == 1], [rng.uniform(-0.5, 0.5, count) * height, height / 2], -height / 2)
    normals = np.where((face == 0)[:, None], around, np.where(face == 1, 1.0, -1.0)[:, None] * up)
    return across[:, None] * around + level[:, None] * up, normals, face


def filleted_drum(
    radius: float, height: float, fillet: float, count: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    """A cylinder (0) with a narrow fillet (3) around its lid (1), and a bottom (2)."""
    rng = np.random.default_rng(0)
    inner, side = radius - fillet, height - fillet
    area = np.array([2 * side * radius, inner**2, radius**2, np.pi * fillet * inner])
    face = rng.choice(4, count, p=area / area.sum())
    angle, turn = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, np.pi / 2, count)
    turn = np.choose(face, [np.zeros(count), np.full(count, np.pi / 2), np.full(count, -np.pi / 2), turn])
    spread = np.sqrt(rng.uniform(0, 1, count))
    across = np.choose(face, [np.full(count, radius), inner * spread, radius * spread, inner + fillet * np.cos(turn)])
    level = np.choose(face, [rng.uniform(0, side, count), np.full(count, height), 0.0, side + fillet * np.sin(turn)])
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.column_stack([across[:, None] * around, level - height / 2])
    return points, np.column_stack([np.cos(turn)[:, None] * around, np.sin(turn)]), face


def extruded(
    profile: list[tuple[float, float]], height: float, cut: list[tuple[int, int, int]] | None = None
) -> Mesh:
    """A prism over a profile, counter-clockwise, whose ends are `cut` into triangles; a fan if it is convex."""
    n = len(profile)
    flat = np.array(profile, dtype=float)
    vertices = np.vstack([np.c_[flat, np.zeros(n)], np.c_[flat, np.full(n, height)]])
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    top = np.array(cut or [(0, k, k + 1) for k in range(1, n - 1)])
    sides = [np.column_stack([i, j, n + j]), np.column_stack([i, n + j, n + i])]
    return Mesh(vertices, np.vstack([*sides, top[:, ::-1], n + top]))


FLAT = 0.02  # width of the planes between two arcs


def bar(flat: float = FLAT, strips: int = 12) -> Mesh:
    """A bar of two half cylinders of radius 1, as strips, with narrow planes between them that both are tangent to."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, strips + 1)
    right = [(flat / 2 + float(np.cos(t)), float(np.sin(t))) for t in turn]
    return extruded(right + [(-x, -y) for x, y in right], 2.0)


def frustum(strips: int = 24) -> Mesh:
    """A cone between two circles: its vertices lie on a sphere, too."""
    turn = 2 * np.pi * np.arange(strips) / strips
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    prism = extruded([(float(x), float(y)) for x, y in ring], 0.3)
    width = np.where(prism.vertices[:, 2:] > 0, 0.8, 1.0)
    return Mesh(prism.vertices * np.hstack([width, width, np.ones_like(width)]), prism.faces)


def turned(profile: list[tuple[float, float]], strips: int = 48) -> Mesh:
    """A profile of radii and heights turned about Z, counter-clockwise, with a lid at each end."""
    turn = 2 * np.pi * np.arange(strips) / strips
    rings = [np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(strips, z)]) for r, z in profile]
    i, j = np.arange(strips), np.roll(np.arange(strips), -1)
    faces = [np.column_stack([np.zeros(strips - 2, int), j[1:-1], i[1:-1]])]
    for k in range(len(profile) - 1):
        low, high = k * strips, (k + 1) * strips
        faces += [np.column_stack([low + i, low + j, high + j]), np.column_stack([low + i, high + j, high + i])]
    last = (len(profile) - 1) * strips
    faces.append(last + np.column_stack([np.zeros(strips - 2, int), i[1:-1], j[1:-1]]))
    return Mesh(np.vstack(rings), np.vstack(faces))
