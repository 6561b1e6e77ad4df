"""Clouds stacked for the network: features, and the rows and neighbours that each layer runs on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from sed2cad.network.features import local_features
from sed2cad.network.graph import SCALES, Cloud, coarse_weights


@dataclass(frozen=True)
class Batch:
    """B clouds; the first `rows` points of each get an output, their neighbours come from all of its points.

    Layer 1 runs on the first max(rows, tables[0]) points of each cloud and looks at all of its points; layer
    2 looks at the first tables[0], layer 3 at the first tables[1].
    """

    clouds: int
    rows: int
    first_rows: Tensor  # rows of `features` that layer 1 runs on
    features: Tensor  # (all points, 58)
    neighbours: tuple[Tensor, Tensor, Tensor]  # per layer (its rows, k), into the stacked table of that layer
    tables: tuple[int, int]  # table sizes per cloud of layers 2 and 3
    coarse_weights: Tensor  # (B rows, k) weights of neighbours[2], to carry values of the coarse points to all

    def to(self, device: str | torch.device) -> Batch:
        """The same batch on another device."""
        a, b, c = (near.to(device) for near in self.neighbours)
        first, features, weights = (t.to(device) for t in (self.first_rows, self.features, self.coarse_weights))
        return Batch(self.clouds, self.rows, first, features, (a, b, c), self.tables, weights)


def stack(clouds: Sequence[Cloud], rows: int | None = None) -> Batch:
    """Stack clouds. Without `rows` every point gets an output (then all clouds must be equally large)."""
    smallest = min(len(cloud.points) for cloud in clouds)
    rows = min(rows or smallest, smallest)
    tables = (min(SCALES[1], smallest), min(SCALES[2], smallest, rows))
    first = max(rows, tables[0])
    near: tuple[list[Tensor], list[Tensor], list[Tensor]] = ([], [], [])
    features: list[Tensor] = []
    weights: list[Tensor] = []
    first_rows: list[Tensor] = []
    start = 0
    for index, cloud in enumerate(clouds):
        points, normals = cloud.points, cloud.normals
        neighbours = torch.from_numpy(cloud.neighbours.astype(np.int64))
        features.append(torch.from_numpy(local_features(points, normals, cloud.neighbours)))
        near[0].append(neighbours[0, :first] + start)
        near[1].append(neighbours[1, :rows] + index * tables[0])
        near[2].append(neighbours[2, :rows] + index * tables[1])
        weights.append(torch.from_numpy(coarse_weights(points, normals, cloud.neighbours[2, :rows])))
        first_rows.append(torch.arange(first) + start)
        start += len(points)
    neighbours_of = (torch.cat(near[0]), torch.cat(near[1]), torch.cat(near[2]))
    return Batch(
        len(clouds),
        rows,
        torch.cat(first_rows),
        torch.cat(features),
        neighbours_of,
        tables,
        torch.cat(weights),
    )
