"""Samples of surfaces beyond their points: in the ball around a gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.scan.scan import Array
from sed2cad.topology.samples import first_of_each

_FIRST = 6  # cells along the box around a ball, before any is divided
_UNSURE = 15.0  # times as uncertain as at its own points a face may be where it goes on
_HALF = np.indices((2, 2, 2)).reshape(3, 8).T - 0.5  # from a cell's centre to those of its eight parts, in their size


def samples_in_ball(primitive: Primitive, centre: Array, radius: float, spacing: float) -> Array:
    """Points (n, 3) of a surface in a ball, about `spacing` apart: cells near the surface are divided (an octree)."""
    levels = max(0, int(np.ceil(np.log2(2 * radius / (_FIRST * spacing)))))
    size = spacing * 2**levels
    cells = np.arange(-radius, radius + size, size)
    found = centre + np.stack(np.meshgrid(cells, cells, cells), axis=-1).reshape(-1, 3)
    for level in range(levels + 1):
        reach = np.sqrt(3) / 2 * size
        inside = np.linalg.norm(found - centre, axis=1) < radius + reach
        found = found[inside]
        found = found[np.abs(primitive.distance(found)) < reach]
        if level < levels:
            size /= 2
            found = (found[:, None, :] + size * _HALF).reshape(-1, 3)
    feet = primitive.project(found)
    feet = feet[first_of_each(np.floor(feet / spacing).astype(np.int64))]
    on = np.abs(primitive.distance(feet)) < 0.01 * spacing
    return feet[on & (np.linalg.norm(feet - centre, axis=1) < radius)]


def is_sure(patch: FittedPatch, points: Array, own: Array) -> NDArray[np.bool_]:
    """At which points (n, 3) a surface is known not much worse than at its own (m, 3): a narrow strip tells little."""
    return _variance(patch, points) <= _UNSURE**2 * _variance(patch, own).mean()


def _variance(patch: FittedPatch, points: Array) -> Array:
    """Of the distance of points (n, 3) to the surface, as far as the fit is uncertain (n,)."""
    gradient = patch.primitive.jacobian(points)
    return np.asarray(np.einsum("ij,jk,ik->i", gradient, patch.covariance, gradient))
