"""Scores of one labelled cloud: patches, types and edge points against the truth.

A label below 0 means none: such points belong to no patch, or have no type.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sed2cad.network.types import PATCH_TYPES

LARGE_PATCH = 30
"""Strict P-mIoU is also given on the true patches of this many points of 10,000."""
OF_POINTS = 10_000


@dataclass(frozen=True)
class Matching:
    """True patches after the best one-to-one matching with the patches found; p true patches."""

    iou: NDArray[np.float64]  # (p,) with the matched patch, 0 where there is none
    size: NDArray[np.int64]  # (p,) points
    type: NDArray[np.int64]  # (p,) true type
    right: NDArray[np.bool_]  # (p,) matched by a patch of that type
    large: NDArray[np.bool_]  # (p,) of LARGE_PATCH of OF_POINTS points and more

    @property
    def matched(self) -> NDArray[np.bool_]:
        """(p,) true patches that share points with their match."""
        return self.iou > 0

    @property
    def p_miou(self) -> float:
        """As the paper's code counts: the mean over the matched true patches; NaN where none is."""
        return _mean(self.iou[self.matched])

    @property
    def p_miou_strict(self) -> float:
        """The mean over all true patches: one without a match counts 0."""
        return _mean(self.iou)

    @property
    def p_miou_large(self) -> float:
        """Strict, over the large patches; NaN where there are none."""
        return _mean(self.iou[self.large])

    @property
    def t_miou(self) -> float:
        """As the paper's code counts: the share of matched patches whose type is right; NaN where none is."""
        return _mean(self.right[self.matched])


def match_patches(found: NDArray, true: NDArray, found_types: NDArray | None, true_types: NDArray) -> Matching:
    """Match patches (n,) one to one so that the sum of IoU is greatest (Hungarian, Kuhn 1955).

    The type of a patch is the mode of the types (n,) of its points; without `found_types` none is right.
    """
    patch, found_size = _numbered(found)
    truth, size = _numbered(true)
    both = (patch >= 0) & (truth >= 0)
    common = np.zeros((len(found_size), len(size)))
    np.add.at(common, (patch[both], truth[both]), 1)
    iou = common / (found_size[:, None] + size - common)
    i, j = linear_sum_assignment(iou, maximize=True)
    each, right = np.zeros(len(size)), np.zeros(len(size), bool)
    each[j] = iou[i, j]
    type_ = modes(truth, true_types, len(size))
    if found_types is not None:
        right[j] = (modes(patch, found_types, len(found_size))[i] == type_[j]) & (iou[i, j] > 0)
    return Matching(each, size, type_, right, size * OF_POINTS >= LARGE_PATCH * len(true))


def modes(patches: NDArray, types: NDArray, count: int) -> NDArray[np.int64]:
    """The most frequent type (count,) among the points of each patch; -1 where no point has one."""
    votes = np.zeros((count, len(PATCH_TYPES)), np.int64)
    known = (patches >= 0) & (types >= 0)
    np.add.at(votes, (patches[known], types[known].astype(np.int64)), 1)
    return np.where(votes.any(axis=1), votes.argmax(axis=1), -1)


@dataclass(frozen=True)
class Detection:
    """Counts of points of one kind, which add up over clouds; ratios without points are 0."""

    hits: int  # found and true
    found: int
    true: int

    @classmethod
    def of(cls, found: NDArray[np.bool_], true: NDArray[np.bool_]) -> Detection:
        """Count masks (n,)."""
        return cls(int((found & true).sum()), int(found.sum()), int(true.sum()))

    def __add__(self, other: Detection) -> Detection:
        return Detection(self.hits + other.hits, self.found + other.found, self.true + other.true)

    @property
    def precision(self) -> float:
        return self.hits / max(self.found, 1)

    @property
    def recall(self) -> float:
        return self.hits / max(self.true, 1)

    @property
    def f1(self) -> float:
        return 2 * self.hits / max(self.found + self.true, 1)


def _numbered(labels: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Labels (n,) renumbered from 0 without gaps, -1 for none; and the points (p,) of each."""
    out = np.full(len(labels), -1, np.int64)
    some = labels >= 0
    _, out[some], size = np.unique(labels[some], return_inverse=True, return_counts=True)
    return out, size.astype(np.int64)


def _mean(values: NDArray) -> float:
    return float(values.mean()) if len(values) else float("nan")
