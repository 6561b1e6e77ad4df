"""The losses of SED-Net, equations 3 to 6."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

PULL_MARGIN = 0.5
PUSH_MARGIN = 1.5
EDGE_WEIGHT = 1.2
"""Weight of edge points in the pull term (lambda, eq. 5)."""


@dataclass(frozen=True)
class Target:
    """Truth of the output rows of a batch, n rows, p patches."""

    type: Tensor  # (n,) int64
    edge: Tensor  # (n,) int64, 0 or 1
    patch: Tensor  # (n,) int64, 0 .. p-1 over the whole batch
    cloud: Tensor  # (p,) int64, the cloud of each patch

    def to(self, device: torch.device) -> Target:
        """The same target on another device."""
        return Target(*(part.to(device) for part in (self.type, self.edge, self.patch, self.cloud)))


class Losses(NamedTuple):
    """The terms of the loss, scalars."""

    type: Tensor
    edge: Tensor
    pull: Tensor
    push: Tensor

    def total(self) -> Tensor:
        return self.type + self.edge + self.pull + self.push


def losses(
    type_: Tensor,
    edge: Tensor,
    descriptor: Tensor,
    target: Target,
    push_power: float = 1.0,
    edge_weight: float = EDGE_WEIGHT,
) -> Losses:
    """All terms from logits (n, 6), (n, 2) and descriptors (n, d)."""
    pull, push = embedding_loss(descriptor, target, push_power, edge_weight)
    return Losses(functional.cross_entropy(type_, target.type), edge_loss(edge, target.edge), pull, push)


def edge_loss(logits: Tensor, edge: Tensor) -> Tensor:
    """Equation 4: edge points weigh 1, the others together as much; half the mean over edge points."""
    edges = edge.sum().clamp_min(1)
    weight = torch.where(edge == 1, 1.0, edges / (len(edge) - edges).clamp_min(1))
    return (functional.cross_entropy(logits, edge, reduction="none") * weight).sum() / (2 * edges)


def embedding_loss(
    descriptor: Tensor, target: Target, push_power: float = 1.0, edge_weight: float = EDGE_WEIGHT
) -> tuple[Tensor, Tensor]:
    """Equations 5 and 6: pull descriptors within 0.5 of their patch's mean, push means 1.5 apart.

    Means over clouds. Equation 6 divides the push by K (K - 1); in a short training that is weak for parts of
    many patches, so here it is K (K - 1) ** push_power.
    """
    patches, clouds = len(target.cloud), int(target.cloud.max()) + 1
    size = torch.bincount(target.patch, minlength=patches).to(descriptor)
    mean = descriptor.new_zeros(patches, descriptor.shape[1]).index_add(0, target.patch, descriptor) / size[:, None]
    distance = _norm(descriptor - mean[target.patch])
    excess = (distance - PULL_MARGIN).clamp_min(0) * torch.where(target.edge == 1, edge_weight, 1.0)
    patch_pull = descriptor.new_zeros(patches).index_add(0, target.patch, excess) / size
    pull = push = descriptor.new_zeros(())
    for cloud in range(clouds):
        own = target.cloud == cloud
        pull = pull + patch_pull[own].mean()
        count = int(own.sum())
        if count > 1:
            gap = _norm(mean[own][:, None] - mean[own][None])
            missing = (PUSH_MARGIN - gap).clamp_min(0).triu(1).sum()
            push = push + 2 * missing / (count * (count - 1) ** push_power)
    return pull / clouds, push / clouds


def _norm(vectors: Tensor) -> Tensor:
    """Length of the last axis, with a gradient at zero."""
    return (vectors.square().sum(-1) + 1e-8).sqrt()
