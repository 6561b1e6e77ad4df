"""Planes and quadrics through the neighbourhoods of points, and how well their slopes are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.scan import Array

TWO_SHEETS = 1.4
"""Kurtosis below which points are both sides of a thin plate: 1 for two sheets, 1.8 even, 3 Gaussian."""
SURELY = 2.0
"""Deviations by which a residual exceeds the noise before the fit is thought to be of the wrong shape."""
TERMS = 6
"""Of a quadric: its height is 1, u, v, u u, u v, v v by so many coefficients."""
_TINY = 1e-12  # unit frame, squared


@dataclass(frozen=True)
class LocalFits:
    """For each of n points a surface that was fitted to its neighbourhood, as a tangent plane."""

    normals: Array  # (n, 3)
    centres: Array  # (n, 3): a point of the plane
    residual: Array  # (n,) variance of the neighbourhood about the surface
    shape: Array  # (n,) as much of it as the noise does not explain
    slope: Array  # (n,) squared tilt, radians^2, that a unit of random variance leaves
    height: Array  # (n,) variance of the surface's height at the point that it leaves
    width: Array  # (n,) variance of the neighbourhood across the normal, the narrower way
    gap: Array  # (n,) half the distance of the two sheets that the plane lies between, 0 where there is one

    @classmethod
    def empty(cls, count: int) -> Self:
        """Room for so many."""
        return cls(np.empty((count, 3)), np.empty((count, 3)), *np.empty((6, count)))

    def __getitem__(self, rows: NDArray[np.int64]) -> LocalFits:
        """Those of some points."""
        return LocalFits(*(column[rows] for column in vars(self).values()))

    def put(self, rows: NDArray[np.int64], other: LocalFits, chosen: NDArray[np.bool_]) -> None:
        """Replace some rows (m,) by those of another that are chosen (m,)."""
        for mine, theirs in zip(vars(self).values(), vars(other).values()):
            mine[rows[chosen]] = theirs[chosen]

    def tilt(self, of: NDArray[np.int64] | slice = slice(None)) -> Array:
        """Expected squared tilt (n,), radians^2: chance falls with the number of points, the wrong shape does not."""
        return np.asarray(self.residual[of] * self.slope[of] + self.shape[of] / self.width[of])

    def feet(self, points: Array) -> Array:
        """The points (n, 3) moved onto their planes, or the sheets beside these."""
        off = np.einsum("ij,ij->i", self.normals, points - self.centres)
        return np.asarray(points - (off - np.sign(off) * self.gap)[:, None] * self.normals)

    def unsure(self) -> Array:
        """Variance (n,) of the feet along the normal."""
        return np.asarray(self.residual * self.height + self.shape)


def fit_planes(local: Array, noise: float) -> tuple[LocalFits, Array]:
    """Least-squares planes of neighbourhoods (n, k, 3), whose noise is a variance, and their axes (n, 3, 3)."""
    n, k, _ = local.shape
    centres = local.mean(axis=1)
    local = local - centres[:, None]
    variances, axes = np.linalg.eigh(local.transpose(0, 2, 1) @ local / k)
    variance, width = np.maximum(variances[:, 0], 0), np.maximum(variances[:, 1], _TINY)
    off = np.abs(np.einsum("nki,ni->nk", local, axes[:, :, 0]))
    sheets = (off**4).sum(axis=1) < TWO_SHEETS * k * variance**2
    gap = np.where(sheets, off.mean(axis=1), 0.0)
    free = max(k - 3, 1)
    residual = (variance - gap**2) * k / free + _TINY
    shape = _shape(residual, noise, free)
    normals, slope, height = axes[:, :, 0].copy(), 1 / (k * width), np.full(n, 3 / k)
    return LocalFits(normals, centres, residual, shape, slope, height, width, gap), axes


def fit_quadrics(points: Array, local: Array, planes: LocalFits, axes: Array, noise: float) -> LocalFits:
    """Quadrics over the planes of neighbourhoods (n, k > 6, 3), with their tangent planes at the points (n, 3).

    Between two sheets there is none: its slope is unknown.
    """
    n, k, _ = local.shape
    local = (local - planes.centres[:, None]) @ axes
    scale = np.sqrt(np.mean(local[:, :, 1:] ** 2, axis=1)) + np.sqrt(_TINY)
    terms, off = quadric_terms(local[:, :, 1:] / scale[:, None]), local[:, :, 0]
    inverse = np.asarray(np.linalg.inv(terms.swapaxes(1, 2) @ terms + 1e-9 * np.eye(TERMS)), np.float64)
    found = np.einsum("nij,nkj,nk->ni", inverse, terms, off, optimize=True)
    misfit = off - (terms @ found[:, :, None])[:, :, 0]
    residual = np.einsum("nk,nk->n", misfit, misfit) / (k - TERMS) + _TINY

    here = np.einsum("ni,nij->nj", points - planes.centres, axes)[:, 1:] / scale
    value, slopes = quadric_terms(here), _slopes(here) / scale[:, :, None]
    tilt = np.einsum("nsi,ni->ns", slopes, found)
    normals = axes[:, :, 0] - tilt[:, :1] * axes[:, :, 1] - tilt[:, 1:] * axes[:, :, 2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    place = np.column_stack([np.einsum("ni,ni->n", value, found), here * scale])
    return LocalFits(
        normals,
        planes.centres + np.einsum("nij,nj->ni", axes, place),
        residual,
        _shape(residual, noise, k - TERMS),
        np.where(planes.gap > 0, np.inf, _variance(slopes, inverse).max(axis=1)),
        _variance(value[:, None], inverse)[:, 0],
        planes.width,
        np.zeros(n),
    )


def quadric_terms(place: Array) -> Array:
    """Of a quadric (..., 6) at (u, v) = place (..., 2)."""
    u, v = place[..., 0], place[..., 1]
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)


def _slopes(place: Array) -> Array:
    """Derivatives (n, 2, 6) of the terms by u and v at places (n, 2)."""
    u, v = place.T
    zero, one = np.zeros_like(u), np.ones_like(u)
    rows = np.array([[zero, one, zero, 2 * u, v, zero], [zero, zero, one, zero, u, 2 * v]])
    return np.moveaxis(rows, 2, 0)


def _variance(rows: Array, inverse: Array) -> Array:
    """Of rows (n, m, 6) times the coefficients, for a unit of noise: (n, m)."""
    return np.asarray(np.einsum("nsi,nij,nsj->ns", rows, inverse, rows, optimize=True))


def _shape(residual: Array, noise: float, free: int) -> Array:
    """What of a residual variance the noise does not explain, with so many degrees of freedom."""
    return np.maximum(residual - noise * (1 + SURELY * np.sqrt(2 / free)), 0)
