from dataclasses import replace

import numpy as np
import pytest
import torch

from sed2cad.network.architecture import Architecture
from sed2cad.network.batch import stack
from sed2cad.network.dynamic import feature_neighbours, normal_neighbours
from sed2cad.network.graph import Cloud, neighbour_graph
from sed2cad.network.predict import predict
from sed2cad.network.sednet import SedNet
from sed2cad.network.types import BSPLINE, TORUS, from_paper, paper_class
from sed2cad.network.weights import labeller_of


def test_feature_neighbours_stay_in_their_cloud():
    torch.manual_seed(0)
    x = torch.randn(60, 5)
    near = feature_neighbours(x, 2, 4)
    for start in (0, 30):
        cloud = x[start : start + 30]
        true = torch.cdist(cloud, cloud).topk(4, largest=False).indices.sort(1).values
        torch.testing.assert_close(near[start : start + 30].sort(1).values, true + start)


def test_normals_count_among_the_nearest():
    """Two points equally near: the one with the same normal is the nearer one, by 1 to 5."""
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [-1, 0, 0]])
    normals = torch.tensor([[0.0, 0, 1], [0, 0, -1], [0, 0, 1]])
    near = normal_neighbours(torch.cat([points, normals], 1), 1, 2)
    assert set(near[0].tolist()) == {0, 2}


def test_paper_classes():
    types, closed = np.array([0, 3, TORUS, BSPLINE, BSPLINE]), np.array([False, True, True, False, True])
    assert paper_class(types, closed).tolist() == [0, 3, 5, 4, 5]
    back = from_paper(np.array([[0.1, 0, 0, 0, 0.3, 0.6]]))
    np.testing.assert_allclose(back, [[0.1, 0, 0, 0, 0.3, 0.6]])
    np.testing.assert_allclose(from_paper(np.array([[0, 0, 0, 0, 1.0, 0]])), [[0, 0, 0, 0, 0, 1]])


def test_the_papers_network_predicts_our_types():
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shape = Architecture(local_width=0, transformer_layers=0, torus=False, dynamic=16)
    network = SedNet(replace(shape, widths=(16, 16, 32), global_width=64))
    labels = predict(normals, normals, labeller_of(network))
    assert labels.types.shape == (300, 6)
    np.testing.assert_allclose(labels.types.sum(1), 1, rtol=1e-5)
    assert (labels.types[:, TORUS] <= labels.types[:, BSPLINE] + 1e-6).all()


@pytest.mark.parametrize("shape", [Architecture(), Architecture(local_width=0, transformer_layers=0, dynamic=16)])
def test_mixed_precision_runs(shape):
    """On CUDA training autocasts; here the same on the CPU."""
    torch.manual_seed(0)
    points = np.random.default_rng(0).normal(size=(400, 3)).astype(np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    network = SedNet(shape)
    batch = stack([Cloud(points, points, neighbour_graph(points))] * 2)
    with torch.autocast("cpu", torch.bfloat16):
        output = network(batch)
    sum(part.float().square().mean() for part in output).backward()
    assert all(torch.isfinite(part).all() for part in output)
    assert torch.isfinite(network.type_head.weight.grad).all()
