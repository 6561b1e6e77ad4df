"""More and cleaner points for the surface reconstruction: the fitted primitives say where the surface is.

Thin walls and sharp edges need points closer than the scan gives them. Between two neighbours of one patch the
surface is known, so points are added there; between neighbours of two patches the edge is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.scan.scan import Array, Scan

Labels = NDArray[np.int64]

UNLABELLED = -1
_NEIGHBOURS = 10
_LONGEST = 3.0  # spacings: longer pairs of points are not neighbours
_EDGE_ANGLE = np.radians(12.0)  # surfaces that meet at a smaller angle have no edge to sample


@dataclass(frozen=True)
class Samples:
    """Oriented points that know their patch."""

    points: Array  # (n, 3), unit frame
    normals: Array  # (n, 3), unit, outward
    labels: Labels  # (n,) index of the fitted patch or UNLABELLED

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, at: NDArray[np.bool_] | NDArray[np.int64]) -> Samples:
        return Samples(self.points[at], self.normals[at], self.labels[at])

    def __add__(self, other: Samples) -> Samples:
        return Samples(
            np.vstack([self.points, other.points]),
            np.vstack([self.normals, other.normals]),
            np.concatenate([self.labels, other.labels]),
        )


def point_labels(count: int, fitted: Sequence[FittedPatch]) -> Labels:
    """Index of the fitted patch of each of `count` points, or UNLABELLED."""
    labels = np.full(count, UNLABELLED, dtype=np.int64)
    for index, patch in enumerate(fitted):
        labels[patch.patch.indices] = index
    return labels


def on_surfaces(points: Array, labels: Labels, fitted: Sequence[FittedPatch]) -> tuple[Array, Array]:
    """Foot points (n, 3) and outward normals (n, 3) on the primitive of each point's label."""
    feet, normals = points.copy(), np.zeros_like(points)
    for label in np.unique(labels[labels >= 0]):
        at = labels == label
        feet[at] = fitted[label].primitive.project(points[at])
        normals[at] = fitted[label].sign * fitted[label].primitive.normal(feet[at])
    return feet, normals


def cleaned(scan: Scan, fitted: Sequence[FittedPatch]) -> Samples:
    """The scan's points moved onto their primitives; those that do not fit theirs stay, unlabelled."""
    labels = point_labels(len(scan.points), fitted)
    feet, normals = on_surfaces(scan.points, labels, fitted)
    moved = np.linalg.norm(feet - scan.points, axis=1)
    agrees = np.einsum("ij,ij->i", normals, scan.normals)
    fits = (labels >= 0) & (moved < 4 * scan.noise + scan.spacing) & (agrees > 0.5)
    return Samples(
        np.where(fits[:, None], feet, scan.points),
        np.where(fits[:, None], normals, scan.normals),
        np.where(fits, labels, UNLABELLED),
    )


def neighbour_pairs(points: Array, count: int, longest: float) -> NDArray[np.int64]:
    """Pairs (m, 2), i < j, among the `count` nearest neighbours of points (n, 3), not longer than `longest`."""
    _, found = cKDTree(points).query(points, k=count + 1, distance_upper_bound=longest)
    first, rank = np.nonzero(found[:, 1:] < len(points))
    pairs = np.sort(np.column_stack([first, found[first, rank + 1]]), axis=1)
    return np.asarray(np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0), dtype=np.int64)


def crossing(a: Primitive, b: Primitive, points: Array, turns: int = 6) -> tuple[Array, Array]:
    """Points (n, 3) moved onto both primitives by shortest Newton steps, and what distance (n,) is left."""
    found = points.copy()
    for _ in range(turns):
        da, db, na, nb = a.distance(found), b.distance(found), a.normal(found), b.normal(found)
        cosine = np.einsum("ij,ij->i", na, nb)
        determinant = np.maximum(1 - cosine**2, 1e-3)
        found -= ((da - cosine * db) / determinant)[:, None] * na
        found -= ((db - cosine * da) / determinant)[:, None] * nb
    return found, np.maximum(np.abs(a.distance(found)), np.abs(b.distance(found)))


def edge_samples(samples: Samples, fitted: Sequence[FittedPatch], spacing: float) -> Samples:
    """Points where two patches meet, found between their neighbouring points; each appears once for either patch."""
    pairs = neighbour_pairs(samples.points, _NEIGHBOURS, _LONGEST * spacing)
    sides = np.sort(samples.labels[pairs], axis=1)
    two = (sides[:, 0] != sides[:, 1]) & (sides[:, 0] >= 0)
    pairs, sides = pairs[two], sides[two]
    ends = samples.points[pairs]
    middle, size = ends.mean(axis=1), np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    edge, normals, good = middle.copy(), np.zeros((len(pairs), 2, 3)), np.zeros(len(pairs), dtype=bool)
    for a, b in np.unique(sides, axis=0):
        at = np.flatnonzero((sides[:, 0] == a) & (sides[:, 1] == b))
        edge[at], left = crossing(fitted[a].primitive, fitted[b].primitive, middle[at])
        for k, label in enumerate((a, b)):
            normals[at, k] = fitted[label].sign * fitted[label].primitive.normal(edge[at])
        good[at] = left < 1e-2 * spacing
    good &= np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]) < np.cos(_EDGE_ANGLE)
    good &= np.linalg.norm(edge - middle, axis=1) < np.maximum(size, 0.5 * spacing)
    good[good] &= _owned(edge[good], sides[good], samples)
    found = Samples(
        np.repeat(edge[good], 2, axis=0), normals[good].reshape(-1, 3), np.asarray(sides[good].reshape(-1))
    )
    return thinned(found, spacing / 4)


def _owned(points: Array, sides: Labels, samples: Samples) -> NDArray[np.bool_]:
    """Whether the sample nearest to each of points (n, 3) carries one of its labels (n, 2)."""
    _, nearest = cKDTree(samples.points).query(points)
    return np.asarray((samples.labels[nearest][:, None] == sides).any(axis=1))


def thinned(samples: Samples, cell: float) -> Samples:
    """One sample of each label in each cubic cell."""
    key = np.column_stack([np.floor(samples.points / cell).astype(np.int64), samples.labels])
    _, first = np.unique(key, axis=0, return_index=True)
    return samples[first]


def clearance(points: Array, labels: Labels, normals: Array, samples: Samples, reach: float) -> Array:
    """Distance (n,) to the nearest sample of another patch that faces elsewhere, at most `reach`."""
    distance, found = cKDTree(samples.points).query(points, k=16, distance_upper_bound=reach)
    found = np.minimum(found, len(samples) - 1)
    turned = np.einsum("ikj,ij->ik", samples.normals[found], normals) < 0.7
    other = (samples.labels[found] != labels[:, None]) & turned
    return np.where(other, np.minimum(distance, reach), reach).min(axis=1)


def refined(samples: Samples, fitted: Sequence[FittedPatch], spacing: float, finest: float) -> Samples:
    """Samples and the midpoints between neighbours of one patch, where they are too far apart for what is near."""
    pairs = neighbour_pairs(samples.points, _NEIGHBOURS, _LONGEST * spacing)
    one = (samples.labels[pairs[:, 0]] == samples.labels[pairs[:, 1]]) & (samples.labels[pairs[:, 0]] >= 0)
    pairs = pairs[one]
    ends, labels = samples.points[pairs], samples.labels[pairs[:, 0]]
    size = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    middle, normals = on_surfaces(ends.mean(axis=1), labels, fitted)
    near = clearance(middle, labels, normals, samples, _LONGEST * spacing)
    wanted = np.clip(near / 3, finest, spacing)
    shifted = np.linalg.norm(middle - ends.mean(axis=1), axis=1)
    add = (size > 1.3 * wanted) & (shifted < 0.3 * size) & ~_blocked(middle, labels, normals, size, samples)
    return thinned(samples + Samples(middle[add], normals[add], labels[add]), finest / 2)


def _blocked(middle: Array, labels: Labels, normals: Array, size: Array, samples: Samples) -> NDArray[np.bool_]:
    """Whether something of another patch lies between the ends of a pair: the surface is not known to go on there.

    The back of a thin wall does not count.
    """
    distance, found = cKDTree(samples.points).query(middle, k=8)
    backs = np.einsum("ikj,ij->ik", samples.normals[found], normals) < -0.5
    other = (samples.labels[found] != labels[:, None]) & ~backs
    return np.asarray((other & (distance < 0.45 * size[:, None])).any(axis=1))


def densified(scan: Scan, fitted: Sequence[FittedPatch], rounds: int = 3) -> Samples:
    """The scan's points on their primitives, points along the edges between them, and points in between."""
    samples = cleaned(scan, fitted)
    samples = samples + edge_samples(samples, fitted, scan.spacing)
    for _ in range(rounds):
        samples = refined(samples, fitted, scan.spacing, scan.spacing / 6)
    return samples
