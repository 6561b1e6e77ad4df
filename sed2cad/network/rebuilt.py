"""`dynamic` in numpy, for one cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sed2cad.network.features import Index
from sed2cad.network.layers import Array
from sed2cad.rows import by_rows


def normal_neighbours(points: Array, normals: Array, k: int) -> Index:
    """(n, k) nearest rows by |dp|^2 (3 - 2 n.n'), from points and normals (n, 3)."""
    return _nearest(lambda p, n: _squared(p, points) * (3 - 2 * n @ normals.T), k, points, normals)


def feature_neighbours(x: Array, k: int) -> Index:
    """(n, k) nearest rows in feature space, from x (n, c)."""
    return _nearest(lambda own: _squared(own, x), k, x)


def _squared(own: Array, other: Array) -> Array:
    squares = (own * own).sum(axis=1)[:, None] + (other * other).sum(axis=1)
    return np.maximum(squares - 2 * own @ other.T, 0)


def _nearest(distance: Callable[..., Array], k: int, *arrays: Array) -> Index:
    k = min(k, len(arrays[0]))
    near: Index = by_rows(lambda *own: np.argpartition(distance(*own), k - 1, axis=1)[:, :k], *arrays)
    return near
