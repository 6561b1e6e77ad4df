"""A trained SED-Net at work, in numpy: to load torch takes longer than to label a scan. `sednet` explains its parts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import expit, softmax

from sed2cad.network.architecture import FUSION, GLOBAL_POINTS, Architecture
from sed2cad.network.features import Index, local_features, pair_features
from sed2cad.network.graph import SCALES, Cloud, coarse_weights, neighbour_graph
from sed2cad.network.layers import Array, Layers, leaky
from sed2cad.network.rebuilt import feature_neighbours, normal_neighbours
from sed2cad.network.stored import FORMAT, SHIPPED, stored_weights
from sed2cad.rows import by_rows

_FUSION = np.float32(FUSION)  # keeps arrays in 32 bits


class Said(NamedTuple):
    """What the network says of n points: probabilities of type (n, 6) and edge (n, 2), and descriptors (n, d)."""

    types: Array
    edge: Array
    descriptors: Array


@dataclass(frozen=True)
class Labeller:
    """SED-Net of this shape with these weights."""

    shape: Architecture
    layers: Layers

    @classmethod
    def load(cls, path: Path | None = None) -> Labeller:
        """The network in a file; without a path the shipped one. Raises WeightsError."""
        stored = stored_weights(path or SHIPPED, FORMAT)
        labeller = cls(stored.architecture(), Layers(stored.arrays))
        try:
            labeller.label(_ball(SCALES[2]))
        except (KeyError, ValueError, IndexError) as error:
            raise stored.misfit from error
        return labeller

    def label(self, cloud: Cloud) -> tuple[Said, Array]:
        """What it says of the points of a cloud; and the probability (n, 10) that each lies on one patch with its
        nearest others, 0.5 where there is no pair network."""
        features = by_rows(
            lambda rows: local_features(cloud.points, cloud.normals, cloud.neighbours, rows),
            np.arange(len(cloud.points)),
        )
        local = self._encoded(features, cloud)
        whole = self.layers.linear("decode_global", self._pooled(local))
        if self.shape.transformer_layers:
            local = np.hstack([local, self._attended(local, cloud)])
        said = Said(*by_rows(lambda rows: self._branches(self._decoded(rows, whole)), local))
        return said, self._same(features, cloud.pairs)

    def _encoded(self, features: Array, cloud: Cloud) -> Array:
        """SedNet.encode: (n, stacked widths)."""
        shape, layers = self.shape, self.layers
        x = by_rows(self._embedded, features) if shape.local_width else features[:, :6]
        near = list(cloud.neighbours)
        if shape.dynamic:
            near[0] = normal_neighbours(features[:, :3], features[:, 3:6], shape.dynamic)
        found: list[Array] = []
        for number in range(3):
            if shape.dynamic and number:
                near[number] = feature_neighbours(x, shape.dynamic)
            table = x if shape.dynamic else x[: SCALES[number]]
            x = layers.edge_conv(f"convolutions.{number}", x, table, near[number])
            found.append(x)
        return np.hstack(found)

    def _embedded(self, features: Array) -> Array:
        """LocalNet.embed."""
        standard = self.layers.standard("local", features)
        hidden = self.layers.mlp("local.hidden.1", self.layers.mlp("local.hidden.0", standard))
        return np.hstack([standard, hidden])

    def _pooled(self, local: Array) -> Array:
        """The global feature (1, width)."""
        whole: Array = self.layers.mlp("to_global", local[:GLOBAL_POINTS]).max(axis=0, keepdims=True)
        return whole

    def _attended(self, local: Array, cloud: Cloud) -> Array:
        """CoarseTransformer."""
        tokens = self.layers.linear("transformer.enter", local[: SCALES[2]])
        for number in range(self.shape.transformer_layers):
            name = f"transformer.layers.layers.{number}"
            tokens = self.layers.transformer_layer(name, tokens, self.shape.transformer_heads)
        tokens = self.layers.norm("transformer.norm", tokens)
        near = cloud.neighbours[2]
        weights = coarse_weights(cloud.points, cloud.normals, near)
        found: Array = by_rows(lambda w, at: np.einsum("nk,nkc->nc", w, tokens[at]), weights, near)
        return found

    def _decoded(self, local: Array, whole: Array) -> Array:
        """The point feature, from local (n, .) and global (1, .) feature."""
        return leaky(self.layers.norm("decode_norm", self.layers.linear("decode_local", local) + whole))

    def _branches(self, point: Array) -> Said:
        """SedNet.branches."""
        shape, layers = self.shape, self.layers
        class_feature: Array = layers.mlp("class_branch", point)
        instance: Array = layers.mlp("instance_branch", point) if shape.two_branches else class_feature
        types = softmax(layers.linear("type_head", class_feature), axis=1)
        edge = softmax(layers.linear("edge_head", class_feature), axis=1)
        if shape.two_branches and shape.early_fusion:
            instance = instance + _FUSION * layers.mlp("early", class_feature)
        if shape.two_branches and shape.late_fusion:
            late: Array = np.maximum(layers.linear("late.0", np.hstack([types, edge])), 0)
            instance = instance + _FUSION * late
        return Said(types, edge, layers.linear("descriptor_head.1", layers.mlp("descriptor_head.0", instance)))

    def _same(self, features: Array, near: Index) -> Array:
        """PairNet on each point and its neighbours (n, 10)."""
        if not self.shape.affinity_width:
            return np.full(near.shape, 0.5, np.float32)

        def joined(rows: Index, near: Index) -> Array:
            pairs = pair_features(features, np.repeat(rows, near.shape[1]), near.ravel())
            hidden = self.layers.mlp("affinity.layers.0", self.layers.standard("affinity", pairs))
            hidden = self.layers.mlp("affinity.layers.1", hidden)
            return expit(self.layers.linear("affinity.layers.2", hidden)).reshape(near.shape)

        found: Array = by_rows(joined, np.arange(len(near)), near)
        return found


def _ball(count: int) -> Cloud:
    """A cloud for a trial."""
    points = np.random.default_rng(0).normal(size=(count, 3)).astype(np.float32)
    points /= 2 * np.linalg.norm(points, axis=1, keepdims=True)
    return Cloud(points, 2 * points, neighbour_graph(points))
