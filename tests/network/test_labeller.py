"""At work the network says what it says in training."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from sed2cad.network.affinity import PairNet
from sed2cad.network.architecture import Architecture
from sed2cad.network.batch import stack
from sed2cad.network.features import PAIR_FEATURES, local_features, pair_features
from sed2cad.network.graph import Cloud, neighbour_graph
from sed2cad.network.sednet import SedNet
from sed2cad.network.weights import labeller_of

SMALL = Architecture((8, 8, 16), 32, 16, 8, 4, 8, 2, 12, 3, affinity_width=8)


def shuffled(network):
    """Weights that matter, biases and norms too."""
    torch.manual_seed(0)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, 0.0, 0.5)
    for part in (network.local, network.affinity):
        if part is not None:
            torch.nn.init.normal_(part.mean)
            torch.nn.init.uniform_(part.deviation, 0.5, 2.0)
    return network.eval()


def ball(count):
    normals = np.random.default_rng(0).normal(size=(count, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * np.float32([0.5, 0.3, 0.2])
    return Cloud(points, normals, neighbour_graph(points))


@pytest.mark.parametrize("count", [60, 2_500])
@pytest.mark.parametrize(
    "shape",
    [
        SMALL,
        replace(SMALL, local_width=0, transformer_layers=0),
        replace(SMALL, early_fusion=False, late_fusion=False, affinity_width=0),
        replace(SMALL, two_branches=False),
        replace(SMALL, dynamic=12),
    ],
)
def test_says_what_the_trained_network_says(count, shape):
    network, cloud = shuffled(SedNet(shape)), ball(count)
    with torch.no_grad():
        expected = network(stack([cloud]))
    said, same = labeller_of(network).label(cloud)
    np.testing.assert_allclose(said.types, expected.type.softmax(1).numpy(), atol=2e-4)
    np.testing.assert_allclose(said.edge, expected.edge.softmax(1).numpy(), atol=2e-4)
    scale = expected.descriptor.abs().max().item()
    np.testing.assert_allclose(said.descriptors, expected.descriptor.numpy(), atol=2e-4 * scale)
    assert same.shape == (count, 10)


def test_pairs_are_those_of_the_pair_network():
    network, cloud = shuffled(SedNet(SMALL)), ball(300)
    features = local_features(cloud.points, cloud.normals, cloud.neighbours)
    near = cloud.pairs
    pairs = pair_features(features, np.repeat(np.arange(300), 10), near.ravel())
    assert pairs.shape == (3_000, PAIR_FEATURES) and isinstance(network.affinity, PairNet)
    with torch.no_grad():
        expected = network.affinity(torch.from_numpy(pairs)).sigmoid().view(300, 10).numpy()
    np.testing.assert_allclose(labeller_of(network).label(cloud)[1], expected, atol=1e-5)
