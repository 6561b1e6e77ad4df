"""Which simple curve runs through points: line, circle or ellipse."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.curves import Array, Circle, Curve, Ellipse, Line
from sed2cad.primitives.vectors import tangent_frame

TOLERANCE = 2e-5  # unit frame: the largest distance of a point from a recognised curve


def recognise(points: Array, closed: bool, tolerance: float = TOLERANCE) -> Curve | None:
    """The line, circle or ellipse within `tolerance` of all points (k, 3), the simplest first; or None."""
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre, full_matrices=False)
    if len(axes) < 3 or len(points) < 3:
        return Line(centre, axes[0]) if not closed else None
    candidates: list[Curve | None] = [] if closed else [Line(centre, axes[0])]
    if np.abs((points - centre) @ axes[2]).max() <= tolerance:
        flat = (points - centre) @ axes[:2].T
        candidates += [_circle(flat, centre, axes), _ellipse(flat, centre, axes)]
    for curve in candidates:
        if curve is not None and curve.distance(points).max() <= tolerance:
            return curve
    return None


def _circle(flat: Array, origin: Array, axes: Array) -> Circle | None:
    """Least-squares circle (Kasa) of points (k, 2) in the plane of axes[0], axes[1] through origin."""
    if len(flat) < 4:
        return None
    matrix = np.column_stack([2 * flat, np.ones(len(flat))])
    p, q, rest = np.linalg.lstsq(matrix, (flat**2).sum(axis=1), rcond=None)[0]
    square = rest + p * p + q * q
    if square <= 0:
        return None
    normal = np.cross(axes[0], axes[1])
    centre = origin + p * axes[0] + q * axes[1]
    return Circle(centre, normal, tangent_frame(normal)[0], float(np.sqrt(square)))


def _ellipse(flat: Array, origin: Array, axes: Array) -> Ellipse | None:
    """Least-squares conic of points (k, 2); None where it is no ellipse or far larger than the points."""
    if len(flat) < 6:
        return None
    size = float(np.abs(flat).max())
    u, v = (flat / size).T
    terms = np.column_stack([u * u, u * v, v * v, u, v])
    conic, _, rank, _ = np.linalg.lstsq(terms, np.ones(len(u)), rcond=None)
    matrix = np.array([[conic[0], conic[1] / 2], [conic[1] / 2, conic[2]]])
    if rank < 5 or np.linalg.det(matrix) <= 0:
        return None
    middle = -np.linalg.solve(2 * matrix, conic[3:])
    weights, ways = np.linalg.eigh(matrix / (1 + middle @ matrix @ middle))
    if (weights <= 0).any():
        return None
    major, minor = size / np.sqrt(weights)
    if major > 20 * size:
        return None
    x = ways[0, 0] * axes[0] + ways[1, 0] * axes[1]
    centre = origin + size * (middle[0] * axes[0] + middle[1] * axes[1])
    return Ellipse(centre, np.cross(axes[0], axes[1]), x, float(major), float(minor))
