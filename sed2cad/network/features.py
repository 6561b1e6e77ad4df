"""Local geometric features of points, what their neighbours at three scales say about the surface; and of pairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Index = NDArray[np.int64]

FEATURES = 58
"""10 of the point, 12 invariants per scale, 6 second moments of the normals at the two coarse scales."""
INVARIANT = np.r_[10:22, 22:34, 40:52]
"""The columns that no rotation changes."""
PAIR_FEATURES = 2 * len(INVARIANT) + 5
PAIR_NEIGHBOURS = 10
"""Each point is paired with this many neighbours."""


def local_features(points: Array, normals: Array, neighbours: NDArray, rows: Index | None = None) -> Array:
    """Features (m, 58) of the points in `rows` (m,), or of those that have neighbours; from points and normals (n, 3)
    and neighbours (3, ., k).

    The point: x, n, n.x, x cross n (the normal lines of a cylinder meet its axis: Pottmann's line geometry).
    Each scale: see `_scale`; the coarse ones add the mean of n n'.
    """
    rows = np.arange(neighbours.shape[1]) if rows is None else rows
    near = neighbours[:, rows].astype(np.int64)
    own_p, own_n = points[rows], normals[rows]
    own = [own_p, own_n, np.einsum("ij,ij->i", own_p, own_n)[:, None], np.cross(own_p, own_n)]
    p, n = np.ascontiguousarray(points.T), np.ascontiguousarray(normals.T)
    parts = [column for block in own for column in block.T]
    for scale, index in enumerate(near):
        invariants, moments = _scale(p, n, own_p.T, own_n.T, np.ascontiguousarray(index.T))
        parts += [*invariants, *moments] if scale else invariants
    return np.stack(parts, axis=1)


def _scale(p: Array, n: Array, own_p: Array, own_n: Array, near: Index) -> tuple[list[Array], list[Array]]:
    """12 invariants and 6 moments, each (m,), from p, n (3, all points), those of the rows (3, m) and near (k, m).

    Invariants: mean distance r; mean and maximum of 1 - n.n'; mean, minimum, maximum of the offset from the
    tangent plane over r; the same of the normal curvature dx.dn / dx.dx (asinh); three of the
    normals' covariance.
    """
    dx = [a[near] - own for a, own in zip(p, own_p)]
    m = [a[near] for a in n]
    d2 = _dot(dx, dx)
    mean_d2 = d2.mean(axis=0)
    r = np.sqrt(mean_d2) + np.float32(1e-6)
    turn = 1 - _dot(m, own_n)
    height = _dot(dx, own_n)
    curvature = np.arcsinh(0.5 * (_dot(dx, m) - height) / (d2 + 1e-3 * mean_d2 + 1e-9))
    height /= r
    moments = [(m[i] * m[j]).mean(axis=0) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    lines = [r, turn.mean(axis=0), turn.max(axis=0)]
    for value in (height, curvature):
        lines += [value.mean(axis=0), value.min(axis=0), value.max(axis=0)]
    return lines + _covariance_invariants([a.mean(axis=0) for a in m], moments), moments


def _dot(a: list[Array] | Array, b: list[Array] | Array) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _covariance_invariants(mean: list[Array], moments: list[Array]) -> list[Array]:
    """Roots of trace, second invariant and determinant of the normals' covariance, in units of a normal."""
    x, y, z = mean
    a, b, c = moments[0] - x * x, moments[1] - y * y, moments[2] - z * z
    d, e, f = moments[3] - x * y, moments[4] - x * z, moments[5] - y * z
    trace = np.maximum(a + b + c, 0)
    second = np.maximum(a * b + a * c + b * c - d * d - e * e - f * f, 0)
    determinant = np.abs(a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    return [np.sqrt(trace), (second + 1e-12) ** 0.25, (determinant + 1e-12) ** (1 / 6)]


def pair_features(features: Array, i: Index, j: Index) -> Array:
    """(m, 77), unchanged by rotation and by exchanging i and j (m,), from local features (n, 58).

    Sum and difference of the invariant local features; distance; cosine of the normals; how far each point
    lies off the other's tangent plane (sorted); the normal curvature that would join them.
    """
    a, b = features[i], features[j]
    dx, n, m = (b[:, :3] - a[:, :3]).T, a[:, 3:6].T, b[:, 3:6].T
    distance = np.sqrt(_dot(dx, dx)) + np.float32(1e-9)
    cosine = _dot(n, m)
    off, back = _dot(dx, n) / distance, -_dot(dx, m) / distance
    bend = 0.05 * np.sqrt(np.maximum(1 - cosine, 0)) / distance
    a, b = a[:, INVARIANT], b[:, INVARIANT]
    between = np.stack([np.log(distance), cosine, np.minimum(off, back), np.maximum(off, back), bend], axis=1)
    return np.concatenate([a + b, np.abs(a - b), between], axis=1)
