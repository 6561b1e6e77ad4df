"""Directions of the surface normals from the points alone, up to their sign."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.neighbours import search_tree
from sed2cad.scan.scan import Array

SCALES = (8, 16, 32, 64)
"""Nearest points (itself included) to which planes are fitted: few for detail, many against noise."""
REACH = 16
"""Neighbours whose planes may replace a point's own, and whose normals smooth it."""
BETTER = 1.5
"""A neighbour's plane replaces a point's own when its expected squared error is that many times smaller."""
SMOOTHING = 0.35
"""Width of the smoothing in radians between normals: noise goes, edges stay."""
TWO_SHEETS = 1.4
"""Kurtosis below which points are both sides of a thin plate: 1 for two sheets, 1.8 even, 3 Gaussian."""
CHUNK = 20_000
"""Points whose neighbourhoods are in memory at once."""


@dataclass(frozen=True)
class _Planes:
    """A plane for every point."""

    normals: Array  # (n, 3)
    centres: Array  # (n, 3)
    residual: Array  # (n,) variance along the normal
    spread: Array  # (n,) variance across it, times the number of points
    gap: Array  # (n,) half the distance of the two sheets that the plane lies between, 0 where there is one

    def error(self, points: Array, of: NDArray | slice = slice(None)) -> Array:
        """Expected squared error (n,), in radians^2, of the planes `of` as tangent planes at the points (n,
        3).
        """
        off = np.einsum("ij,ij->i", self.normals[of], points - self.centres[of])
        return (np.maximum(self.residual[of], off**2 / 4) + 1e-12) / (self.spread[of] + 1e-30)

    def put(self, rows: NDArray, other: _Planes) -> None:
        """Replace the planes of some rows by those of another."""
        for mine, theirs in zip(vars(self).values(), vars(other).values()):
            mine[rows] = theirs[rows]


@dataclass(frozen=True)
class Tangents:
    """Tangent planes of the points."""

    normals: Array  # (n, 3), unit, of arbitrary sign
    feet: Array  # (n, 3): the points moved onto their planes, which takes most of the noise away
    near: NDArray[np.int64]  # (n, <= 16): the nearest points, itself first


def tangents(points: Array) -> Tangents:
    """Tangent planes of the points (n, 3) in the unit frame.

    Planes are fitted at several scales and the one with the smallest expected error counts; near an edge that
    is the plane of a neighbour whose neighbourhood does not cross the edge. Two rounds of bilateral smoothing
    follow. Dense scans with noise 0.1 % of R: mean error 3.2 degrees, where 16 neighbours alone give 9.8.
    """
    planes, near = _best_planes(points)
    own = planes.error(points)
    best, choice = own.copy(), np.arange(len(points))
    for j in near.T[1:]:
        error = planes.error(points, j)
        better = error < best
        best[better], choice[better] = error[better], j[better]
    choice = np.where(best < own / BETTER, choice, np.arange(len(points)))
    normals, centres = planes.normals[choice], planes.centres[choice]
    height = np.einsum("ij,ij->i", normals, points - centres)
    feet = points - (height - np.sign(height) * planes.gap[choice])[:, None] * normals
    for _ in range(2):
        normals = _smoothed(normals, near)
    return Tangents(normals, feet, near)


def _best_planes(points: Array) -> tuple[_Planes, NDArray[np.int64]]:
    """The best of the planes at all scales for each point, and its nearest points (n, REACH)."""
    n = len(points)
    near = np.empty((n, min(REACH, n)), dtype=np.int64)
    best = _Planes(np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n), np.empty(n))
    tree = search_tree(points)

    def do(start: int) -> None:
        rows = np.arange(start, min(start + CHUNK, n))
        _, index = tree.query(points[rows], min(SCALES[-1], n))
        near[rows] = index[:, :REACH]
        chosen = _fit(points, index[:, : SCALES[0]])
        for k in SCALES[1:]:
            planes = _fit(points, index[:, :k])
            chosen.put(planes.error(points[rows]) < chosen.error(points[rows]), planes)
        for mine, theirs in zip(vars(best).values(), vars(chosen).values()):
            mine[rows] = theirs

    with ThreadPoolExecutor() as pool:  # numpy and the tree let other threads work meanwhile
        list(pool.map(do, range(0, n, CHUNK)))
    return best, near


def _fit(points: Array, index: NDArray) -> _Planes:
    """Least-squares planes of neighbourhoods given by their points' indices (m, k)."""
    k = index.shape[1]
    local = points[index]
    centres = local.mean(axis=1)
    local -= centres[:, None]
    variances, axes = np.linalg.eigh(local.transpose(0, 2, 1) @ local / k)
    variance = np.maximum(variances[:, 0], 0)
    squared = np.einsum("nki,ni->nk", local, axes[:, :, 0]) ** 2
    sheets = np.einsum("nk,nk->n", squared, squared) < TWO_SHEETS * k * variance**2
    gap = np.where(sheets, np.sqrt(variance), 0.0)
    return _Planes(axes[:, :, 0].copy(), centres, variance * k / (k - 3), k * variances[:, 1], gap)


def _smoothed(normals: Array, near: NDArray) -> Array:
    """Bilateral mean over the nearest points, with weights that fall with the angle between the normals."""
    total = np.zeros_like(normals)
    for j in near.T:
        cosine = np.einsum("ij,ij->i", normals, normals[j])
        weight = np.sign(cosine) * np.exp((np.abs(cosine) - 1) / SMOOTHING**2)
        total += weight[:, None] * normals[j]
    return total / np.linalg.norm(total, axis=1, keepdims=True)
