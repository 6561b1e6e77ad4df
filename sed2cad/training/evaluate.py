"""How good the network's labels are, in the paper's numbers and in stricter ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from sed2cad.network.graph import MAX_POINTS
from sed2cad.network.predict import PointLabels, predict
from sed2cad.network.sednet import SedNet
from sed2cad.network.types import BSPLINE, PATCH_TYPES, TORUS
from sed2cad.segmentation.mean_shift import absorb_small, mean_shift, split_components
from sed2cad.training.augment import turn
from sed2cad.training.dataset import load_part, packed_parts
from sed2cad.training.samples import EDGE_DISTANCE

EDGE_THRESHOLD = 0.75
"""A point counts as an edge point from this probability on."""
LARGE_PATCH = 30
"""Strict P-mIoU is also given on patches of this many points of 10,000."""


@dataclass(frozen=True)
class SegmentationScores:
    """Means over parts, 0 to 1."""

    p_miou: float  # as the paper counts: over the true patches that are matched
    p_miou_strict: float  # an unmatched true patch counts 0
    p_miou_large: float  # strict, true patches of LARGE_PATCH and more points
    t_miou: float  # as the paper counts: matched patches whose type (the mode over their points) is right
    type_accuracy: float  # over points
    edge_precision: float  # over the points of all parts
    edge_recall: float
    edge_f1: float
    parts: int


def evaluate_segmentation(
    data: Path | Sequence[Path], network: SedNet, limit: int | None = None, noise: float = 0.0
) -> SegmentationScores:
    """Score a network on packed parts (a folder or files), the first `limit`.

    `noise`: displacement along the normal, +- this share of the bounding sphere's radius; normals turn by up
    to 5 degrees.
    """
    files = (packed_parts(data) if isinstance(data, Path) else list(data))[:limit]
    rows, edges = [], np.zeros(3)
    for index, path in enumerate(files):
        cloud = load_part(path).sample(np.random.default_rng(0), MAX_POINTS)
        points: NDArray = cloud.points
        normals: NDArray = cloud.normals
        if noise:
            rng = np.random.default_rng(index)
            radius = np.linalg.norm(points, axis=1).max()
            points = points + normals * rng.uniform(-noise * radius, noise * radius, (len(points), 1))
            normals = turn(normals, 5.0, rng)
        labels = predict(points, normals, network)
        patches = propose_patches(points, labels)
        types, true_types = labels.types.argmax(1), cloud.type
        if not network.shape.torus:  # the paper's classes do not know it
            types, true_types = (np.where(ids == TORUS, BSPLINE, ids) for ids in (types, true_types))
        accuracy = float((types == true_types).mean())
        rows.append((*score_patches(patches, cloud.patch, types, true_types), accuracy))
        found, true = labels.edge > EDGE_THRESHOLD, cloud.edge_distance < EDGE_DISTANCE
        edges += (found & true).sum(), found.sum(), true.sum()
    usual, strict, large, type_, accuracy = np.nanmean(np.array(rows), axis=0).tolist()
    precision, recall = edges[0] / max(edges[1], 1), edges[0] / max(edges[2], 1)
    f1 = 2 * precision * recall / max(precision + recall, 1e-9)
    return SegmentationScores(
        usual, strict, large, type_, accuracy, float(precision), float(recall), float(f1), len(files)
    )


def propose_patches(points: NDArray, labels: PointLabels) -> NDArray[np.int64]:
    """Patches (n,) from the descriptors alone: mean shift, connected, no crumbs."""
    neighbours = cKDTree(points).query(points, k=11)[1][:, 1:]
    return absorb_small(split_components(mean_shift(labels.descriptors), neighbours), neighbours)


def score_patches(
    found: NDArray, true: NDArray, found_types: NDArray, true_types: NDArray
) -> tuple[float, float, float, float]:
    """Usual, strict and large-patch P-mIoU, and T-mIoU, after the best one-to-one matching (Hungarian)."""
    found, true = (np.unique(labels, return_inverse=True)[1] for labels in (found, true))
    common = np.zeros((found.max() + 1, true.max() + 1))
    np.add.at(common, (found, true), 1)
    size = common.sum(0)
    iou = common / (common.sum(1)[:, None] + size - common)
    i, j = linear_sum_assignment(iou, maximize=True)
    i, j = i[iou[i, j] > 0], j[iou[i, j] > 0]
    each = np.zeros(len(size))
    each[j] = iou[i, j]
    right = _mode(found, found_types)[i] == _mode(true, true_types)[j]
    large = each[size >= LARGE_PATCH]
    return (
        float(iou[i, j].mean()),
        float(each.mean()),
        float(large.mean()) if len(large) else np.nan,
        right.mean(),
    )


def _mode(patches: NDArray, types: NDArray) -> NDArray:
    """The most frequent type of each patch."""
    votes = np.zeros((patches.max() + 1, len(PATCH_TYPES)))
    np.add.at(votes, (patches, types.astype(np.int64)), 1)
    return votes.argmax(1)


def as_dict(scores: SegmentationScores) -> dict[str, float]:
    """Scores rounded, for a log."""
    return {field.name: round(getattr(scores, field.name), 4) for field in fields(scores)}
