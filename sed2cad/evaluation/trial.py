"""A labelled part as a scan: its cloud, noise, and the pipeline's preparation."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.evaluation.methods import Labelling
from sed2cad.network.graph import MAX_POINTS
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Scan
from sed2cad.training.augment import MAX_TURN, turn
from sed2cad.training.dataset import load_part
from sed2cad.training.labelled_part import LabelledCloud

SAME_POINT = 1e-9
"""Longest side 1: a cloud's point and a scan's point at most so far apart are one."""


@dataclass(frozen=True)
class Trial:
    """A scan of a cloud of n points, and which point of the scan is which of the cloud."""

    scan: Scan
    row: NDArray[np.int64]  # (n,) index into the scan's points, -1 where `prepare` dropped the point
    seconds: float  # that `prepare` took

    def to_cloud(self, found: Labelling) -> Labelling:
        """Labels of the scan's points as labels of the cloud's; dropped points get none."""
        kept = self.row >= 0
        return replace(
            found,
            patch=np.where(kept, found.patch[self.row], -1),
            type=None if found.type is None else np.where(kept, found.type[self.row], -1),
            edge=kept & found.edge[self.row],
        )


def cloud_of(path: Path, points: int | None, seed: int) -> LabelledCloud:
    """`points` labelled points (None: MAX_POINTS) of a packed part, the same for the same seed."""
    return load_part(path).sample(np.random.default_rng(seed), points or MAX_POINTS)


def make_trial(cloud: LabelledCloud, noise: float, seed: int, name: str = "scan") -> Trial:
    """A scan of the cloud with noise, prepared as the pipeline does. Raises ScanError.

    `noise`: displacement along the normal, uniform within +- this share of the bounding sphere's radius;
    normals turn by up to MAX_TURN degrees (the paper, Table 3).
    """
    points, normals = cloud.points.astype(np.float64), cloud.normals.astype(np.float64)
    if noise:
        rng = np.random.default_rng([seed, 1])  # with cloud_of's generator, noise would follow the triangles
        reach = noise * np.linalg.norm(points, axis=1).max()
        points = points + normals * rng.uniform(-reach, reach, (len(points), 1))
        normals = turn(normals, MAX_TURN, rng)
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        scan = prepare(RawScan(points, normals, name=name), seed)
    seconds = time.perf_counter() - start
    distance, row = cKDTree(scan.frame.to_world(scan.points)).query(points)
    return Trial(scan, np.where(distance <= SAME_POINT, row, -1), seconds)
