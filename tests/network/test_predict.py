import numpy as np
import pytest
import torch

from sed2cad.network.architecture import Architecture
from sed2cad.network.predict import predict, to_unit_frame
from sed2cad.network.sednet import SedNet
from sed2cad.network.weights import labeller_of


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return labeller_of(SedNet(Architecture(affinity_width=16)))


def box(n, seed=0):
    """Points and normals of a box, in millimetres and far from the origin."""
    rng = np.random.default_rng(seed)
    side = rng.integers(0, 3, n)
    points, normals = rng.uniform(-1, 1, (n, 3)), np.zeros((n, 3))
    sign = rng.choice([-1.0, 1.0], n)
    points[np.arange(n), side] = normals[np.arange(n), side] = sign
    return points * [40, 30, 20] + [100, 0, 0], normals


@pytest.mark.parametrize("n", [50, 700, 10_500])
def test_shapes_for_any_number_of_points(network, n):
    points, normals = box(n)
    labels = predict(points, normals, network)
    m = min(n, 10_000)
    assert labels.seen.shape == (m,) and (np.diff(labels.seen) > 0).all()
    assert labels.nearest.shape == (n,)
    np.testing.assert_array_equal(labels.nearest[labels.seen], np.arange(m))
    assert labels.types.shape == (m, 6)
    assert labels.edge.shape == (m,)
    assert labels.descriptors.shape == (m, 128)
    assert labels.neighbours.shape == labels.same.shape == (m, 10)
    np.testing.assert_allclose(labels.types.sum(1), 1, rtol=1e-5)
    assert all(
        np.isfinite(part).all() for part in (labels.types, labels.edge, labels.descriptors, labels.same)
    )
    assert (labels.neighbours != np.arange(m)[:, None]).all()


def test_neighbours_are_near(network):
    points, normals = box(10_500)
    labels = predict(points, normals, network)
    seen = points[labels.seen]
    gap = np.linalg.norm(seen[labels.neighbours] - seen[:, None], axis=2)
    assert gap.max() < 6


def test_deterministic_for_a_seed_and_free_of_unit_and_place(network):
    points, normals = box(800)
    a, b = predict(points, normals, network, seed=3), predict(points, normals, network, seed=3)
    np.testing.assert_array_equal(a.descriptors, b.descriptors)
    moved = predict(points * 8 + 64, normals, network, seed=3)
    np.testing.assert_allclose(moved.types, a.types, atol=2e-3)


def test_input_is_left_alone(network):
    points, normals = box(100)
    before = points.copy()
    predict(points, normals, network)
    np.testing.assert_array_equal(points, before)


def test_ablations_run():
    points, normals = box(300)
    plain = Architecture(local_width=0, transformer_layers=0, early_fusion=False, late_fusion=False)
    assert predict(points, normals, labeller_of(SedNet(plain))).types.shape == (300, 6)


def test_unit_frame():
    points = to_unit_frame(np.array([[0.0, 0, 0], [10, 4, 2]]))
    np.testing.assert_allclose(points, [[-0.5, -0.2, -0.1], [0.5, 0.2, 0.1]], atol=1e-7)
