"""A tiny network that says of two neighbouring points whether they lie on one patch."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sed2cad.network.edgeconv import Mlp
from sed2cad.network.features import PAIR_FEATURES


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
