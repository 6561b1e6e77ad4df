"""Scores of one method on one part, and their summary over parts."""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.evaluation.methods import Labelling
from sed2cad.evaluation.metrics import Detection, match_patches
from sed2cad.network.types import PATCH_TYPES
from sed2cad.training.labelled_part import LabelledCloud
from sed2cad.training.samples import EDGE_DISTANCE

NAN = float("nan")


@dataclass(frozen=True)
class ClassCounts:
    """Points and true patches of one type; they add up over parts."""

    points: int = 0
    right: int = 0  # of those, labelled with the type
    patches: int = 0
    iou: float = 0.0  # sum over the patches, 0 for one without a match

    def __add__(self, other: ClassCounts) -> ClassCounts:
        return ClassCounts(
            self.points + other.points,
            self.right + other.right,
            self.patches + other.patches,
            self.iou + other.iou,
        )

    @property
    def type_accuracy(self) -> float:
        return self.right / self.points if self.points else NAN

    @property
    def p_miou_strict(self) -> float:
        return self.iou / self.patches if self.patches else NAN


@dataclass(frozen=True)
class Seconds:
    """What the stages of one part took."""

    scan: float = 0.0
    network: float = 0.0  # 0 for methods without it
    patches: float = 0.0

    @property
    def total(self) -> float:
        return self.scan + self.network + self.patches


@dataclass(frozen=True)
class PartScores:
    """One method on one part; ratios 0 to 1, NaN where there is nothing to score."""

    part: str
    method: str
    p_miou: float  # as the paper counts: over the true patches that are matched
    p_miou_strict: float  # an unmatched true patch counts 0
    p_miou_large: float  # strict, large true patches (see metrics.LARGE_PATCH)
    t_miou: float  # as the paper counts: matched patches whose type is right; NaN without types
    type_accuracy: float  # over points; NaN without types
    edge: Detection
    classes: tuple[ClassCounts, ...]  # in the order of PATCH_TYPES
    seconds: Seconds
    peak_mb: float  # of the process so far
    error: str = ""  # why the method gave nothing; all points are then without label


def score(
    part: str, method: str, cloud: LabelledCloud, found: Labelling, seconds: Seconds, error: str = ""
) -> PartScores:
    """Compare what a method says about the cloud's n points with the truth."""
    true_type = cloud.type.astype(np.int64)
    right = np.zeros(len(true_type), bool) if found.type is None else found.type == true_type
    matching = match_patches(found.patch, cloud.patch, found.type, true_type)
    return PartScores(
        part=part,
        method=method,
        p_miou=matching.p_miou,
        p_miou_strict=matching.p_miou_strict,
        p_miou_large=matching.p_miou_large,
        t_miou=NAN if found.type is None else matching.t_miou,
        type_accuracy=NAN if found.type is None else float(right.mean()),
        edge=Detection.of(found.edge, cloud.edge_distance < EDGE_DISTANCE),
        classes=_classes(true_type, right, matching.type, matching.iou),
        seconds=seconds,
        peak_mb=peak_memory(),
        error=error,
    )


@dataclass(frozen=True)
class MethodScores:
    """One method over all parts: means over parts; edges and classes over the points of all parts."""

    method: str
    parts: int
    failed: int  # parts on which it raised an error, or which could not be prepared
    p_miou: float
    p_miou_strict: float
    p_miou_large: float
    t_miou: float
    type_accuracy: float
    edge_precision: float
    edge_recall: float
    edge_f1: float
    seconds: Seconds  # a part
    peak_mb: float  # the largest of a process, all methods of its parts together
    classes: tuple[ClassCounts, ...]

    def ratios(self) -> dict[str, float]:
        """The scores alone, for a log."""
        names = ("p_miou", "p_miou_strict", "p_miou_large", "t_miou", "type_accuracy")
        return {name: getattr(self, name) for name in (*names, "edge_precision", "edge_recall", "edge_f1")}


def summarise(rows: Sequence[PartScores]) -> MethodScores:
    """Scores of one method on at least one part, put together."""
    edge = sum((row.edge for row in rows), Detection(0, 0, 0))
    classes = (sum(counts, ClassCounts()) for counts in zip(*(row.classes for row in rows)))
    return MethodScores(
        method=rows[0].method,
        parts=len(rows),
        failed=sum(bool(row.error) for row in rows),
        p_miou=_mean(row.p_miou for row in rows),
        p_miou_strict=_mean(row.p_miou_strict for row in rows),
        p_miou_large=_mean(row.p_miou_large for row in rows),
        t_miou=_mean(row.t_miou for row in rows),
        type_accuracy=_mean(row.type_accuracy for row in rows),
        edge_precision=edge.precision,
        edge_recall=edge.recall,
        edge_f1=edge.f1,
        seconds=Seconds(
            _mean(row.seconds.scan for row in rows),
            _mean(row.seconds.network for row in rows),
            _mean(row.seconds.patches for row in rows),
        ),
        peak_mb=max(row.peak_mb for row in rows),
        classes=tuple(classes),
    )


def peak_memory() -> float:
    """Largest resident memory of this process so far, MB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)  # bytes there, kilobytes here


def _classes(
    true_type: NDArray[np.int64], right: NDArray[np.bool_], patch_type: NDArray[np.int64], iou: NDArray
) -> tuple[ClassCounts, ...]:
    """Counts of each type from points (n,) and true patches (p,)."""
    size = len(PATCH_TYPES)
    points, hits = np.bincount(true_type, minlength=size), np.bincount(true_type[right], minlength=size)
    patches = np.bincount(patch_type, minlength=size)
    sums = np.bincount(patch_type, weights=iou, minlength=size)
    return tuple(ClassCounts(int(points[k]), int(hits[k]), int(patches[k]), float(sums[k])) for k in range(size))


def _mean(values: Iterable[float]) -> float:
    """The mean of those that are not NaN; NaN where none is."""
    some = [value for value in values if value == value]
    return float(np.mean(some)) if some else NAN
