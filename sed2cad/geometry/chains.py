"""Chains: from boundary points of the proxy mesh to points on both surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sed2cad.geometry.contact import Contact, Meeting, Side, relative_curvature
from sed2cad.geometry.curves import Array
from sed2cad.primitives.vectors import unit

_LONGEST_STEP = 0.02  # unit frame
_LEAST_CURVATURE = 0.3  # 1 / unit: bounds how far a flat contact can push sideways


@dataclass(frozen=True)
class Projected:
    """Chain points moved onto both surfaces."""

    points: Array  # (n, 3)
    residual: Array  # (n,): larger of the two distances, unit frame
    moved: Array  # (n,)


def smoothed(points: Array, closed: bool, passes: int = 8) -> Array:
    """Points (n, 3) freed from zigzag but not shrunk (Taubin 1995); the ends of an open chain stay.

    A ring of fewer than about 12 points does shrink.
    """
    points = points.copy()
    for _ in range(passes):
        for weight in (0.5, -0.53):
            if closed:
                points += weight * ((np.roll(points, 1, axis=0) + np.roll(points, -1, axis=0)) / 2 - points)
            else:
                points[1:-1] += weight * ((points[2:] + points[:-2]) / 2 - points[1:-1])
    return points


def length(points: Array, closed: bool) -> float:
    """Length of the polygon through points (n, 3)."""
    if closed:
        points = np.vstack([points, points[:1]])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def resampled(points: Array, count: int, closed: bool) -> Array:
    """`count` points (count, 3) at even lengths along the polygon; a closed one does not repeat its first."""
    if closed:
        points = np.vstack([points, points[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], count + 1)[:-1] if closed else np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, points[:, k]) for k in range(3)])


def between(points: Array, start: Array, end: Array) -> Array:
    """The open chain points (n, 3), its ends moved to start and end (3,), the rest shifted smoothly along."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    share = (along / max(float(along[-1]), 1e-300))[:, None]
    return points + (1 - share) * (start - points[0]) + share * (end - points[-1])


def onto_both(a: Side, b: Side, points: Array, how: Meeting) -> Projected:
    """Newton from points (n, 3) to the common curve of a and b, each step the shortest that would do.

    Touching surfaces: (d_a + d_b) / 2 = 0 and (n_a - n_b) . u = 0, u from the relative curvature. A resting
    chain keeps its place sideways: only the first.
    """
    found = points.copy()
    contact: Contact | None = None
    small = 1e-8 if a.free or b.free else 1e-12
    for turn in range(30):
        if how == "crossing":
            step = _crossing_step(a, b, found)
        elif how == "resting":
            step = _middle_step(a, b, found)
        else:
            if contact is None or turn < 4 or turn % 5 == 0:
                contact = relative_curvature(a, b, found)
            step = _touching_step(a, b, found, contact)
        size = np.linalg.norm(step, axis=1)
        found -= step * np.minimum(1.0, _LONGEST_STEP / np.maximum(size, 1e-300))[:, None]
        if size.max() < small:
            break
    moved = np.asarray(np.linalg.norm(found - points, axis=1))
    return Projected(found, off_surfaces(a, b, found), moved)


def off_surfaces(a: Side, b: Side, points: Array) -> Array:
    """The larger of the distances (n,) of points (n, 3) to a and b."""
    return np.maximum(np.abs(a.primitive.distance(points)), np.abs(b.primitive.distance(points)))


def _crossing_step(a: Side, b: Side, points: Array) -> Array:
    """The least-norm solution of d_a = d_b = 0, linearised."""
    da, db = a.primitive.distance(points), b.primitive.distance(points)
    na, nb = a.primitive.normal(points), b.primitive.normal(points)
    cosine = np.einsum("ij,ij->i", na, nb)
    determinant = np.maximum(1 - cosine**2, 1e-6)
    along_a = (da - cosine * db) / determinant
    along_b = (db - cosine * da) / determinant
    return along_a[:, None] * na + along_b[:, None] * nb


def _middle_step(a: Side, b: Side, points: Array) -> Array:
    """To the surface midway between a and b, along the mean normal."""
    middle = 0.5 * (a.sign * a.primitive.distance(points) + b.sign * b.primitive.distance(points))
    return np.asarray(middle[:, None] * unit(a.outward(points) + b.outward(points)))


def _touching_step(a: Side, b: Side, points: Array, contact: Contact) -> Array:
    """To the middle surface and, sideways on it, to where the normals agree."""
    normal = unit(a.outward(points) + b.outward(points))
    difference = np.einsum("ij,ij->i", a.outward(points) - b.outward(points), contact.across)
    push = difference / np.maximum(contact.curvature, _LEAST_CURVATURE)
    sideways = contact.sideways - np.einsum("ij,ij->i", contact.sideways, normal)[:, None] * normal
    return np.asarray(_middle_step(a, b, points) + push[:, None] * sideways)
