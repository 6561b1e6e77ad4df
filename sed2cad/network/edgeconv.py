"""EdgeConv computed per point: it is linear before its max, so no (n, k, c) tensor is needed."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from sed2cad.network.architecture import SLOPE


class EdgeConv(nn.Module):
    """One EdgeConv layer (Wang et al. 2019), as SED-Net stacks three of.

    max_j (W1 x_i + W2 (x_j - x_i)) = (W1 - W2) x_i + max_j W2 x_j = A x_i + max_j B x_j; norm and LeakyReLU
    0.2 follow the max.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.own = nn.Linear(inputs, outputs)
        self.other = nn.Linear(inputs, outputs, bias=False)
        self.norm = nn.LayerNorm(outputs)

    def forward(self, x: Tensor, table: Tensor, neighbours: Tensor) -> Tensor:
        """x (n, inputs), table (m, inputs) that `neighbours` (n, k) index; returns (n, outputs)."""
        highest = functional.embedding_bag(neighbours, self.other(table), mode="max")
        return functional.leaky_relu(self.norm(self.own(x) + highest), SLOPE)


class Mlp(nn.Sequential):
    """Linear, norm, LeakyReLU: one shared layer."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.LeakyReLU(SLOPE))


def interpolate(table: Tensor, neighbours: Tensor, weights: Tensor) -> Tensor:
    """Weighted sums of table rows: (m, c), (n, k), (n, k) -> (n, c)."""
    return functional.embedding_bag(neighbours, table, mode="sum", per_sample_weights=weights.to(table.dtype))
