"""Clean samples of the surface: the scan's points, moved onto the primitives of their patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import UNLABELLED, FittedPatch, point_labels
from sed2cad.scan.scan import Array, Scan

Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Samples:
    """Points on one surface, or on two of them where these meet in an edge."""

    points: Array  # (n, 3), unit frame
    labels: Labels  # (n, 2) indices of fitted patches; twice the same within a face; UNLABELLED: none
    normals: Array  # (n, 2, 3) outward unit normals of the two
    convex: Mask  # (n,) whether the edge is convex; True within a face

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, at: Mask | Labels | slice) -> Samples:
        return Samples(self.points[at], self.labels[at], self.normals[at], self.convex[at])

    def __add__(self, other: Samples) -> Samples:
        return Samples(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.labels, other.labels]),
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.convex, other.convex]),
        )

    @property
    def on_edge(self) -> Mask:
        """Whether each sample lies on an edge (n,)."""
        return np.asarray(self.labels[:, 0] != self.labels[:, 1])

    @classmethod
    def within_faces(cls, points: Array, labels: Labels, normals: Array) -> Samples:
        """Samples of one surface each: points (n, 3), labels (n,), normals (n, 3)."""
        twice = np.repeat(normals[:, None, :], 2, axis=1)
        return cls(points, np.column_stack([labels, labels]), twice, np.ones(len(points), dtype=bool))


def on_surfaces(points: Array, labels: Labels, fitted: Sequence[FittedPatch]) -> tuple[Array, Array]:
    """Foot points and outward normals (n, 3) on the primitive of each label; unlabelled points stay."""
    feet, normals = points.copy(), np.zeros_like(points)
    for label in np.unique(labels[labels >= 0]):
        at = labels == label
        feet[at] = fitted[label].primitive.project(points[at])
        normals[at] = fitted[label].sign * fitted[label].primitive.normal(feet[at])
    return feet, normals


def settled_labels(scan: Scan, fitted: Sequence[FittedPatch]) -> Labels:
    """Labels (n,) of the points, each the best of its own and its neighbours': distance, normal and votes.

    A point that none of these surfaces explains is UNLABELLED.
    """
    labels = point_labels(len(scan.points), fitted)
    around = labels[scan.around]
    best, price = np.full(len(labels), UNLABELLED, dtype=np.int64), np.full(len(labels), 6.0)
    unit = 2 * scan.noise + 0.15 * scan.spacing
    for label, patch in enumerate(fitted):
        votes = (around == label).sum(axis=1) + (labels == label)
        at = np.flatnonzero(votes)
        distance = patch.primitive.distance(scan.points[at]) / (unit + patch.rms)
        cosine = patch.sign * np.einsum("ij,ij->i", patch.primitive.normal(scan.points[at]), scan.normals[at])
        cost = np.minimum(distance**2, 9.0) + 8 * (1 - cosine) + 2 * (1 - votes[at] / (around.shape[1] + 1))
        better = cost < price[at]
        best[at[better]], price[at[better]] = label, cost[better]
    return best


def face_samples(scan: Scan, fitted: Sequence[FittedPatch]) -> Samples:
    """The points on the primitives of their labels; unlabelled ones as they are, if they are not alone."""
    labels = settled_labels(scan, fitted)
    explained = (labels[scan.around[:, 1:]] >= 0).mean(axis=1)
    use = (labels >= 0) | (explained < 0.7)
    feet, normals = on_surfaces(scan.points, labels, fitted)
    normals = np.where((labels >= 0)[:, None], normals, scan.normals)
    return Samples.within_faces(feet, labels, normals)[use]


def thinned(samples: Samples, cell: float) -> Samples:
    """One sample of each pair of labels in each cubic cell."""
    key = np.column_stack([np.floor(samples.points / cell).astype(np.int64), samples.labels])
    return samples[first_of_each(key)]


def first_of_each(rows: Labels) -> Labels:
    """Where each distinct one of rows (n, d) comes first, in the order of the rows: np.unique, many times faster."""
    if len(rows) == 0 or np.log2((spans := np.ptp(rows, axis=0) + 1).astype(float)).sum() > 62:
        return np.unique(rows, axis=0, return_index=True)[1]
    return np.unique(np.ravel_multi_index((rows - rows.min(axis=0)).T, spans), return_index=True)[1]
