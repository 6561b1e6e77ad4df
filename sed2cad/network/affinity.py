"""A tiny network that says of two neighbouring points whether they lie on one patch."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sed2cad.network.edgeconv import Mlp
from sed2cad.network.features import INVARIANT

PAIR_FEATURES = 2 * len(INVARIANT) + 5
PAIR_NEIGHBOURS = 10
"""Each point is paired with this many neighbours."""
CHUNK = 200_000
"""Pairs at a time, to bound the memory."""


class PairNet(nn.Module):
    """Point-wise network on standardised pair features."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            Mlp(PAIR_FEATURES, width), Mlp(width, width // 2), nn.Linear(width // 2, 1)
        )
        self.register_buffer("mean", torch.zeros(PAIR_FEATURES))
        self.register_buffer("deviation", torch.ones(PAIR_FEATURES))

    def forward(self, pairs: Tensor) -> Tensor:
        """Logits (m,) of "same patch" from pair features (m, 77)."""
        return self.layers((pairs - self.mean) / self.deviation)[:, 0]


def pair_features(features: Tensor, i: Tensor, j: Tensor) -> Tensor:
    """(m, 77), unchanged by rotation and by exchanging i and j (m,), from local features (n, 58).

    Sum and difference of the invariant local features; distance; cosine of the normals; how far each point
    lies off the other's tangent plane (sorted); the normal curvature that would join them.
    """
    a, b = features[i], features[j]
    dx, n, m = b[:, :3] - a[:, :3], a[:, 3:6], b[:, 3:6]
    distance = dx.norm(dim=1, keepdim=True) + 1e-9
    cosine = (n * m).sum(1, keepdim=True)
    off = torch.cat([(dx * n).sum(1, keepdim=True), -(dx * m).sum(1, keepdim=True)], 1) / distance
    bend = 0.05 * (1 - cosine).clamp_min(0).sqrt() / distance
    a, b = a[:, INVARIANT], b[:, INVARIANT]
    sorted_off = [off.amin(1, keepdim=True), off.amax(1, keepdim=True)]
    return torch.cat([a + b, (a - b).abs(), distance.log(), cosine, *sorted_off, bend], 1)


def same_patch(network: PairNet, features: Tensor, neighbours: Tensor) -> Tensor:
    """Probabilities (n, k) that point i and its neighbours[i] (n, k) lie on one patch."""
    n, k = neighbours.shape
    i, j = torch.arange(n).repeat_interleave(k), neighbours.reshape(-1)
    with torch.no_grad():
        parts = [network(pair_features(features, a, b)) for a, b in zip(i.split(CHUNK), j.split(CHUNK))]
    return torch.cat(parts).sigmoid().view(n, k)
