import numpy as np
import pytest
from scipy.spatial import cKDTree

from sed2cad.segmentation.mean_shift import absorb_small, mean_shift


def clusters(count, each=200, spread=0.1, seed=0):
    rng = np.random.default_rng(seed)
    centres = rng.permutation(np.eye(16))[:count] * 2
    labels = np.repeat(np.arange(count), each)
    return centres[labels] + rng.normal(0, spread / 4, (len(labels), 16)), labels


def same_partition(a, b):
    pairs = np.unique(np.c_[a, b], axis=0)
    return len(pairs) == len(np.unique(a)) == len(np.unique(b))


@pytest.mark.parametrize("count", [1, 2, 12])
def test_separates_clear_clusters(count):
    descriptors, truth = clusters(count)
    assert same_partition(mean_shift(descriptors), truth)


def test_merges_modes_nearer_than_twice_the_bandwidth():
    descriptors = np.r_[np.full((50, 2), 0.0), np.full((50, 2), 0.3)]
    assert mean_shift(descriptors, bandwidth=0.3).max() == 0
    assert mean_shift(descriptors, bandwidth=0.1).max() == 1


def test_same_seed_same_labels():
    descriptors = np.random.default_rng(1).normal(size=(3_000, 8))
    np.testing.assert_array_equal(mean_shift(descriptors, seed=5), mean_shift(descriptors, seed=5))


def line(x):
    return cKDTree(np.c_[x]).query(np.c_[x], k=3)[1][:, 1:]


def test_absorb_gives_crumbs_to_their_neighbours():
    labels = np.r_[np.zeros(10, int), np.full(3, 1), np.full(12, 2)]
    result = absorb_small(labels, line(np.arange(25.0)), minimum=5)
    assert len(np.unique(result)) == 2
    assert result[0] == result[10]
    assert result[12] == result[-1]


def test_absorb_keeps_an_island_as_one_patch():
    x = np.r_[np.arange(20.0), 500 + np.arange(4.0)]
    labels = np.r_[np.zeros(20, int), 1, 2, 3, 4]
    assert same_partition(absorb_small(labels, line(x)), np.repeat([0, 1], [20, 4]))
