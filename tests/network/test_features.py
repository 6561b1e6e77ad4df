import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from sed2cad.network.features import FEATURES, INVARIANT, local_features
from sed2cad.network.graph import neighbour_graph


def features_of(points, normals):
    near = torch.from_numpy(neighbour_graph(points).astype(np.int64))
    return local_features(torch.tensor(points).float(), torch.tensor(normals).float(), near)


def ball(n=3_000, radius=0.5):
    normals = np.random.default_rng(0).normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def test_plane_has_no_curvature():
    points = np.c_[np.random.default_rng(0).random((400, 2)), np.zeros(400)]
    features = features_of(points, np.tile([0.0, 0, 1], (400, 1)))
    assert features.shape == (400, FEATURES)
    assert features[:, 11:19].abs().max() < 1e-5  # turn, height and curvature at the finest scale


def test_sphere_has_the_curvature_of_its_radius():
    """dx.dn / dx.dx = 1 / r on a sphere, so the largest is asinh(1 / 2r)."""
    points, normals = ball()
    curvature = features_of(points, normals)[:, 18]
    assert np.sinh(curvature.median()) / 0.5 == pytest.approx(2.0, rel=0.05)


def test_invariants_do_not_turn():
    points, normals = ball()
    points = points * [1, 0.6, 0.3]
    turn = Rotation.random(random_state=1).as_matrix()
    a, b = features_of(points, normals), features_of(points @ turn.T, normals @ turn.T)
    difference = (a[:, INVARIANT] - b[:, INVARIANT]).abs()
    assert difference.quantile(0.99) < 1e-3
