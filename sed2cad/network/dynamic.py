"""Graphs rebuilt before each EdgeConv: nearest rows of the same cloud, by normals first, then by features."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

CHUNK = 1_024
"""Rows whose distances to all others are in memory at once."""


@torch.no_grad()
def normal_neighbours(x: Tensor, clouds: int, k: int) -> Tensor:
    """(B n, k) nearest rows by |dp|^2 (3 - 2 n.n'), from points and normals x (B n, 6), B clouds of n rows."""

    def distance(own: Tensor, other: Tensor) -> Tensor:
        return _squared(own[:, :3], other[:, :3]) * (3 - 2 * own[:, 3:] @ other[:, 3:].T)

    return _nearest(x, clouds, k, distance)


@torch.no_grad()
def feature_neighbours(x: Tensor, clouds: int, k: int) -> Tensor:
    """(B n, k) nearest rows in feature space, from x (B n, c)."""
    return _nearest(x, clouds, k, _squared)


def _squared(own: Tensor, other: Tensor) -> Tensor:
    squares = own.square().sum(1)[:, None] + other.square().sum(1)
    return (squares - 2 * own @ other.T).clamp_min(0)


def _nearest(x: Tensor, clouds: int, k: int, distance: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """Row indices (B n, min(k, n)) into all rows."""
    x, found, start = x.float(), [], 0
    with torch.autocast(x.device.type, enabled=False):  # distances of near points need all of their digits
        for cloud in x.chunk(clouds):
            for own in cloud.split(CHUNK):
                near = distance(own, cloud).topk(min(k, len(cloud)), dim=1, largest=False, sorted=False)
                found.append(near.indices + start)
            start += len(cloud)
    return torch.cat(found)
