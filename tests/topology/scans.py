"""Small scans whose topology is known, with the true patches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.scan.scan import Array, Frame, Mesh, Scan

Z = np.array([0.0, 0.0, 1.0])
Sampler = Callable[[np.random.Generator, int], Array]
Piece = tuple[Primitive, int, float, Sampler]  # surface, sign, area, points on it


def scan_of(
    pieces: list[Piece], count: int = 5000, turn: Array | None = None
) -> tuple[Scan, list[FittedPatch]]:
    """About `count` exact points on the pieces (never fewer than 30 on one), and the patches."""
    rng = np.random.default_rng(1)
    total = sum(area for _, _, area, _ in pieces)
    points, normals, fitted, first = [], [], [], 0
    for primitive, sign, area, sampler in pieces:
        on_it = sampler(rng, max(30, round(count * area / total)))
        points.append(on_it)
        normals.append(sign * primitive.normal(on_it))
        indices = np.arange(first, first + len(on_it))
        first += len(on_it)
        patch = Patch(indices, primitive.kind, np.ones(len(on_it), dtype=bool))
        covariance = 1e-12 * np.eye(primitive.freedom)
        fitted.append(FittedPatch(patch, _turned(primitive, turn), sign, 0.0, covariance))
    turn = np.eye(3) if turn is None else turn
    at, out = np.vstack(points) @ turn.T, np.vstack(normals) @ turn.T
    near, _ = cKDTree(at).query(at, k=2)
    return Scan(at, out, None, Frame(np.zeros(3), 1.0), 0.0, float(np.median(near[:, 1]))), fitted


def _turned(primitive: Primitive, turn: Array | None) -> Primitive:
    """The primitive under the rotation `turn` (3, 3)."""
    if turn is None:
        return primitive
    parameters = {
        name: tuple(turn @ np.asarray(value)) if isinstance(value, tuple) else value
        for name, value in primitive.parameters().items()
    }
    return type(primitive).from_parameters(parameters)


def rectangle(axis: int, side: int, size: Array, hole: float = 0.0) -> Piece:
    """A side of the box `size` (3,) about the origin, perhaps with a hole around the axis."""
    normal = side * np.eye(3)[axis]
    others = [k for k in range(3) if k != axis]

    def points(rng: np.random.Generator, count: int) -> Array:
        found = size * (rng.random((8 * count, 3)) - 0.5)
        found[:, axis] = side * size[axis] / 2
        return found[np.linalg.norm(found[:, others], axis=1) > hole][:count]

    return Plane(normal, size[axis] / 2), 1, float(np.prod(size[others]) - np.pi * hole**2), points


def wall(radius: float, low: float, high: float, sign: int = 1) -> Piece:
    """A cylinder around z."""

    def points(rng: np.random.Generator, count: int) -> Array:
        angle, height = 2 * np.pi * rng.random(count), rng.uniform(low, high, count)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])

    return Cylinder(Z, np.zeros(3), radius), sign, 2 * np.pi * radius * (high - low), points


def ring(inner: float, outer: float, height: float, side: int) -> Piece:
    """A disc or an annulus across z that faces `side` (+1 up, -1 down)."""

    def points(rng: np.random.Generator, count: int) -> Array:
        angle, radius = 2 * np.pi * rng.random(count), np.sqrt(rng.uniform(inner**2, outer**2, count))
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)])

    return Plane(side * Z, side * height), 1, np.pi * (outer**2 - inner**2), points


def chamfer(low: tuple[float, float], high: tuple[float, float]) -> Piece:
    """A cone around z that narrows upwards, between two (radius, height)."""
    (wide, bottom), (narrow, top) = low, high
    slope = (wide - narrow) / (top - bottom)
    apex = np.array([0.0, 0.0, bottom + wide / slope])

    def points(rng: np.random.Generator, count: int) -> Array:
        angle, radius = 2 * np.pi * rng.random(count), np.sqrt(rng.uniform(narrow**2, wide**2, count))
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), apex[2] - radius / slope])

    area = np.pi * (wide + narrow) * np.hypot(wide - narrow, top - bottom)
    return Cone(-Z, apex, float(np.arctan(slope))), 1, area, points


def box(size: tuple[float, float, float] = (0.7, 0.5, 0.4)) -> list[Piece]:
    return [rectangle(axis, side, np.array(size)) for axis in range(3) for side in (-1, 1)]


def box_with_hole(radius: float = 0.12) -> list[Piece]:
    size = np.array([0.7, 0.5, 0.4])
    sides = [
        rectangle(axis, side, size, radius if axis == 2 else 0.0) for axis in range(3) for side in (-1, 1)
    ]
    return [*sides, wall(radius, -0.2, 0.2, -1)]


def stacked_cylinder() -> list[Piece]:
    low, middle, high = -0.3, 0.0, 0.3
    return [
        ring(0.0, 0.35, low, -1),
        wall(0.35, low, middle),
        ring(0.2, 0.35, middle, 1),
        wall(0.2, middle, high),
        ring(0.0, 0.2, high, 1),
    ]


def sphere(radius: float = 0.3) -> list[Piece]:
    def points(rng: np.random.Generator, count: int) -> Array:
        way = rng.standard_normal((count, 3))
        return radius * way / np.linalg.norm(way, axis=1)[:, None]

    return [(Sphere(np.zeros(3), radius), 1, 4 * np.pi * radius**2, points)]


def torus(major: float = 0.3, minor: float = 0.12) -> list[Piece]:
    def points(rng: np.random.Generator, count: int) -> Array:
        around, angle = 2 * np.pi * rng.random((2, count))
        reach = major + minor * np.cos(angle)
        return np.column_stack([reach * np.cos(around), reach * np.sin(around), minor * np.sin(angle)])

    return [(Torus(Z, np.zeros(3), major, minor), 1, 4 * np.pi**2 * major * minor, points)]


def box_mesh(size: tuple[float, float, float]) -> Mesh:
    """The 12 triangles of a box, each with vertices of its own (as in an STL file)."""
    corners = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * np.array(size)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return Mesh(corners[faces.ravel()], np.arange(36).reshape(12, 3))
