"""SED-Net: EdgeConv encoder and two branches (type and edge; descriptor) joined by two-stage fusion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from sed2cad.network.affinity import PairNet
from sed2cad.network.architecture import FUSION, GLOBAL_POINTS, SLOPE, Architecture
from sed2cad.network.batch import Batch
from sed2cad.network.dynamic import feature_neighbours, normal_neighbours
from sed2cad.network.edgeconv import EdgeConv, Mlp, interpolate
from sed2cad.network.features import FEATURES
from sed2cad.network.types import PATCH_TYPES


class Output(NamedTuple):
    """Logits of type (n, 6) and edge (n, 2), and descriptors (n, d)."""

    type: Tensor
    edge: Tensor
    descriptor: Tensor


class LocalNet(nn.Module):
    """Point-wise network on standardised local features; trained first and alone, then frozen."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        self.hidden = nn.Sequential(Mlp(FEATURES, width), Mlp(width, width))
        self.head = nn.Linear(width, len(PATCH_TYPES) + 2)
        self.register_buffer("mean", torch.zeros(FEATURES))
        self.register_buffer("deviation", torch.ones(FEATURES))

    def embed(self, features: Tensor) -> Tensor:
        """(n, 58) -> (n, 58 + width): the standardised features and what the network makes of them."""
        standard = (features - self.mean) / self.deviation
        return torch.cat([standard, self.hidden(standard)], 1)

    def forward(self, features: Tensor) -> Tensor:
        """Logits of type and edge, (n, 6 + 2)."""
        return self.head(self.hidden((features - self.mean) / self.deviation))


class CoarseTransformer(nn.Module):
    """Attention among the coarse points of each cloud, carried back to all points."""

    def __init__(self, inputs: int, shape: Architecture) -> None:
        super().__init__()
        width = shape.transformer_width
        self.enter = nn.Linear(inputs, width)
        layer = nn.TransformerEncoderLayer(
            width, shape.transformer_heads, 2 * width, 0.0, "gelu", batch_first=True, norm_first=True
        )
        self.layers = nn.TransformerEncoder(layer, shape.transformer_layers, enable_nested_tensor=False)
        self.norm = nn.LayerNorm(width)

    def forward(self, local: Tensor, batch: Batch) -> Tensor:
        """local (B rows, inputs) -> (B rows, width)."""
        coarse = _first(local, batch.clouds, batch.tables[1])
        tokens = self.norm(self.layers(self.enter(coarse).view(batch.clouds, batch.tables[1], -1)))
        return interpolate(tokens.flatten(0, 1), batch.neighbours[2], batch.coarse_weights)


class SedNet(nn.Module):
    """The network of the paper, section 3, with local features and a coarse transformer as settings."""

    def __init__(self, shape: Architecture | None = None) -> None:
        super().__init__()
        self.shape = shape = shape or Architecture()
        self.local = LocalNet(shape.local_width).requires_grad_(False) if shape.local_width else None
        self.affinity = PairNet(shape.affinity_width).requires_grad_(False) if shape.affinity_width else None
        inputs = FEATURES + shape.local_width if shape.local_width else 6
        widths = (inputs, *shape.widths)
        self.convolutions = nn.ModuleList(EdgeConv(a, b) for a, b in pairwise(widths))
        stacked = sum(shape.widths)
        self.to_global = Mlp(stacked, shape.global_width)
        self.transformer = CoarseTransformer(stacked, shape) if shape.transformer_layers else None
        local_width = stacked + (shape.transformer_width if shape.transformer_layers else 0)
        self.decode_local = nn.Linear(local_width, shape.point_width)
        self.decode_global = nn.Linear(shape.global_width, shape.point_width, bias=False)
        self.decode_norm = nn.LayerNorm(shape.point_width)
        self.class_branch = Mlp(shape.point_width, shape.branch_width)
        two = shape.two_branches
        self.instance_branch = Mlp(shape.point_width, shape.branch_width) if two else None
        self.type_head = nn.Linear(shape.branch_width, len(PATCH_TYPES))
        self.edge_head = nn.Linear(shape.branch_width, 2)
        self.early = Mlp(shape.branch_width, shape.branch_width) if two and shape.early_fusion else None
        late = nn.Sequential(nn.Linear(len(PATCH_TYPES) + 2, shape.branch_width), nn.ReLU())
        self.late = late if two and shape.late_fusion else None
        self.descriptor_head = nn.Sequential(
            Mlp(shape.branch_width, shape.branch_width), nn.Linear(shape.branch_width, shape.descriptor)
        )

    def forward(self, batch: Batch) -> Output:
        """Output for the first `batch.rows` points of each cloud, stacked."""
        return self.branches(self.decode(self.encode(batch), batch))

    def attach(self, affinity: PairNet, width: int) -> None:
        """Take a trained pair network along; `predict` uses it."""
        self.affinity, self.shape = affinity.requires_grad_(False), replace(self.shape, affinity_width=width)

    def encode(self, batch: Batch) -> Tensor:
        """Three EdgeConv layers at three scales, concatenated: (B rows, 256)."""
        if self.shape.dynamic:
            return self._encode_dynamic(batch)
        with torch.no_grad():
            table = batch.features[:, :6] if self.local is None else self.local.embed(batch.features)
        x1 = self.convolutions[0](table[batch.first_rows], table, batch.neighbours[0])
        table, x1 = _first(x1, batch.clouds, batch.tables[0]), _first(x1, batch.clouds, batch.rows)
        x2 = self.convolutions[1](x1, table, batch.neighbours[1])
        x3 = self.convolutions[2](x2, _first(x2, batch.clouds, batch.tables[1]), batch.neighbours[2])
        return torch.cat([x1, x2, x3], 1)

    def _encode_dynamic(self, batch: Batch) -> Tensor:
        """The same with graphs among the rows of layer 1, rebuilt before each layer (the paper's form)."""
        x, layers = batch.features[batch.first_rows], list[Tensor]()
        near = normal_neighbours(x[:, :6], batch.clouds, self.shape.dynamic)
        x = x[:, :6] if self.local is None else self.local.embed(x)
        for layer in self.convolutions:
            near = near if not layers else feature_neighbours(x, batch.clouds, self.shape.dynamic)
            x = layer(x, x, near)
            layers.append(x)
        return _first(torch.cat(layers, 1), batch.clouds, batch.rows)

    def decode(self, local: Tensor, batch: Batch) -> Tensor:
        """Local and global feature to the point feature (B rows, 512); the layer is split in two."""
        some = _first(local, batch.clouds, min(GLOBAL_POINTS, batch.rows))
        whole = self.to_global(some).view(batch.clouds, -1, self.shape.global_width).amax(1)
        if self.transformer is not None:
            local = torch.cat([local, self.transformer(local, batch)], 1)
        mixed = self.decode_local(local).view(batch.clouds, batch.rows, -1) + self.decode_global(whole)[:, None]
        return functional.leaky_relu(self.decode_norm(mixed), SLOPE).flatten(0, 1)

    def branches(self, point: Tensor) -> Output:
        """Classification and instance branch with early and late fusion; or one branch for both."""
        class_feature = self.class_branch(point)
        instance = class_feature if self.instance_branch is None else self.instance_branch(point)
        type_, edge = self.type_head(class_feature), self.edge_head(class_feature)
        if self.early is not None:
            instance = instance + FUSION * self.early(class_feature)
        if self.late is not None:
            instance = instance + FUSION * self.late(torch.cat([type_.softmax(1), edge.softmax(1)], 1))
        return Output(type_, edge, self.descriptor_head(instance))


def _first(rows: Tensor, clouds: int, count: int) -> Tensor:
    """The first `count` rows of each cloud of equally many stacked rows."""
    return rows.view(clouds, -1, rows.shape[-1])[:, :count].reshape(clouds * count, -1)
