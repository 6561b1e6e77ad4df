import numpy as np
import pytest
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from sed2cad.segmentation.linkage import MOST, average_linkage


def same_partition(a, b):
    return len(np.unique(np.column_stack([a, b]), axis=0)) == len(np.unique(a)) == len(np.unique(b))


@pytest.mark.parametrize("seed", range(5))
def test_on_a_complete_graph_it_is_the_textbooks_average_linkage(seed):
    """scipy's UPGMA on distances MOST - evidence, cut where the mean evidence is 0."""
    rng = np.random.default_rng(seed)
    n = 24
    evidence = rng.uniform(-3, 3, (n, n)) + 2 * (np.arange(n)[:, None] // 6 == np.arange(n) // 6)
    evidence = np.clip((evidence + evidence.T) / 2, -MOST, MOST - 1.5)
    np.fill_diagonal(evidence, MOST)
    tree = linkage(squareform(MOST - evidence), "average")
    expected = fcluster(tree, MOST, "distance")
    others = np.array([[j for j in range(n) if j != i] for i in range(n)])
    found = average_linkage(np.take_along_axis(evidence, others, axis=1), others)
    assert same_partition(found, expected)


def test_one_strong_bridge_does_not_join_two_clusters():
    """Two rings of 20 that touch in many unlikely pairs and in one likely one stay apart."""
    ring = np.arange(20)
    near = np.vstack([np.column_stack([(ring + 1) % 20, (ring + 2) % 20, ring + 20]), np.zeros((20, 3), int)])
    near[20:] = np.column_stack([(ring + 1) % 20 + 20, (ring + 2) % 20 + 20, ring])
    evidence = np.tile([4.0, 4.0, -2.0], (40, 1))
    evidence[0, 2] = 3.0
    found = average_linkage(evidence, near)
    assert same_partition(found, np.repeat([0, 1], 20))


def test_sure_pairs_join_at_once():
    near = np.array([[1], [2], [3], [2]])
    assert same_partition(average_linkage(np.array([[MOST], [-1.0], [MOST], [MOST]]), near), [0, 0, 1, 1])
