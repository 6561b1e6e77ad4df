import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sed2cad.network.features import FEATURES, INVARIANT, local_features, pair_features
from sed2cad.network.graph import neighbour_graph


def features_of(points, normals):
    return local_features(points.astype(np.float32), normals.astype(np.float32), neighbour_graph(points))


def ball(n=3_000, radius=0.5):
    normals = np.random.default_rng(0).normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def test_plane_has_no_curvature():
    points = np.c_[np.random.default_rng(0).random((400, 2)), np.zeros(400)]
    features = features_of(points, np.tile([0.0, 0, 1], (400, 1)))
    assert features.shape == (400, FEATURES)
    assert np.abs(features[:, 11:19]).max() < 1e-5  # turn, height and curvature at the finest scale


def test_sphere_has_the_curvature_of_its_radius():
    """dx.dn / dx.dx = 1 / r on a sphere, so the largest is asinh(1 / 2r)."""
    points, normals = ball()
    curvature = features_of(points, normals)[:, 18]
    assert np.sinh(np.median(curvature)) / 0.5 == pytest.approx(2.0, rel=0.05)


def test_invariants_do_not_turn():
    points, normals = ball()
    points = points * [1, 0.6, 0.3]
    turn = Rotation.random(random_state=1).as_matrix()
    a, b = features_of(points, normals), features_of(points @ turn.T, normals @ turn.T)
    assert np.quantile(np.abs(a[:, INVARIANT] - b[:, INVARIANT]), 0.99) < 1e-3


def test_pair_features_do_not_know_which_point_comes_first():
    features = np.random.default_rng(0).normal(size=(20, FEATURES)).astype(np.float32)
    i, j = np.arange(10), np.arange(10, 20)
    np.testing.assert_allclose(pair_features(features, i, j), pair_features(features, j, i), rtol=1e-5)


def test_features_of_some_rows():
    points, normals = (a.astype(np.float32) for a in ball(500))
    near, rows = neighbour_graph(points), np.array([3, 499, 7])
    np.testing.assert_allclose(
        local_features(points, normals, near, rows), local_features(points, normals, near)[rows], atol=1e-6
    )
