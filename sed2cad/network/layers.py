"""The layers of a trained network, in numpy, by the names that torch gives their weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, softmax

from sed2cad.network.architecture import SLOPE
from sed2cad.rows import by_rows

Array = NDArray[np.float32]

EPSILON = 1e-5
"""Of a layer norm."""


@dataclass(frozen=True)
class Layers:
    """Layers with these weights; all take and give rows."""

    weights: dict[str, Array]

    def linear(self, name: str, x: Array) -> Array:
        """(n, a) -> (n, b)."""
        y = x @ self.weights[f"{name}.weight"].T
        bias = self.weights.get(f"{name}.bias")
        if bias is not None:
            y += bias
        return y

    def norm(self, name: str, x: Array) -> Array:
        """Layer norm."""
        x = x - x.mean(axis=1, keepdims=True)
        x /= np.sqrt(np.einsum("ij,ij->i", x, x)[:, None] / x.shape[1] + EPSILON)
        x *= self.weights[f"{name}.weight"]
        x += self.weights[f"{name}.bias"]
        return x

    def mlp(self, name: str, x: Array) -> Array:
        """See `edgeconv.Mlp`."""
        return leaky(self.norm(f"{name}.1", self.linear(f"{name}.0", x)))

    def standard(self, name: str, x: Array) -> Array:
        """Standardised columns."""
        return (x - self.weights[f"{name}.mean"]) / self.weights[f"{name}.deviation"]

    def edge_conv(self, name: str, x: Array, table: Array, neighbours: NDArray) -> Array:
        """See `edgeconv.EdgeConv`: x (n, a), table (m, a), neighbours (n, k) -> (n, b)."""
        other = by_rows(lambda rows: self.linear(f"{name}.other", rows), table)

        def convolve(own: Array, near: NDArray) -> Array:
            highest = other[near[:, 0]]
            for column in near.T[1:]:
                np.maximum(highest, other[column], out=highest)
            return leaky(self.norm(f"{name}.norm", self.linear(f"{name}.own", own) + highest))

        return by_rows(convolve, x, neighbours)

    def attention(self, name: str, x: Array, heads: int) -> Array:
        """Self-attention among all rows (Vaswani et al. 2017)."""
        qkv = x @ self.weights[f"{name}.in_proj_weight"].T + self.weights[f"{name}.in_proj_bias"]
        q, k, v = qkv.reshape(len(x), 3, heads, -1).transpose(1, 2, 0, 3)
        shares = softmax(q @ k.transpose(0, 2, 1) / np.float32(np.sqrt(q.shape[2])), axis=2)
        return self.linear(f"{name}.out_proj", (shares @ v).transpose(1, 0, 2).reshape(len(x), -1))

    def transformer_layer(self, name: str, x: Array, heads: int) -> Array:
        """torch's TransformerEncoderLayer, the norms first, with GELU."""
        x = x + self.attention(f"{name}.self_attn", self.norm(f"{name}.norm1", x), heads)
        hidden = self.linear(f"{name}.linear1", self.norm(f"{name}.norm2", x))
        hidden *= 0.5 * (1 + erf(hidden / np.float32(np.sqrt(2))))
        return x + self.linear(f"{name}.linear2", hidden)


def leaky(x: Array) -> Array:
    """LeakyReLU."""
    return np.maximum(x, np.float32(SLOPE) * x)
