import math

import pytest
import torch

from sed2cad.training.losses import Target, edge_loss, embedding_loss, losses


def target(patch, edge, cloud):
    zeros = torch.zeros(len(patch), dtype=torch.int64)
    return Target(zeros, torch.tensor(edge), torch.tensor(patch), torch.tensor(cloud))


def test_pull_is_free_within_the_margin_and_linear_beyond():
    """Two points 4 apart: each is 2 from the mean, 1.5 beyond the margin; an edge point weighs 1.2."""
    descriptors = torch.tensor([[0.0, 0], [4, 0]])
    pull, push = embedding_loss(descriptors, target([0, 0], [0, 1], [0]))
    assert float(pull) == pytest.approx((1.5 + 1.2 * 1.5) / 2, rel=1e-4)
    assert float(push) == 0
    near, _ = embedding_loss(descriptors / 5, target([0, 0], [0, 1], [0]))
    assert float(near) == pytest.approx(0, abs=1e-6)


def test_push_is_the_mean_over_ordered_pairs():
    """Means at 0, 1 and 5: only the first pair is nearer than 1.5, by 0.5; 2 of 6 ordered pairs."""
    descriptors = torch.tensor([[0.0], [1], [5]])
    truth = target([0, 1, 2], [0, 0, 0], [0, 0, 0])
    assert float(embedding_loss(descriptors, truth)[1]) == pytest.approx(0.5 * 2 / 6, rel=1e-4)
    assert float(embedding_loss(descriptors, truth, push_power=0)[1]) == pytest.approx(0.5 * 2 / 3, rel=1e-4)


def test_clouds_do_not_push_each_other():
    descriptors = torch.zeros(2, 3)
    assert float(embedding_loss(descriptors, target([0, 1], [0, 0], [0, 1]))[1]) == 0


def test_edge_loss_balances_the_classes():
    """Undecided logits cost log 2 whatever the share of edge points."""
    for edges in (1, 5):
        edge = torch.tensor([1] * edges + [0] * (10 - edges))
        assert float(edge_loss(torch.zeros(10, 2), edge)) == pytest.approx(math.log(2), rel=1e-5)


def test_without_edge_points_nothing_breaks():
    terms = losses(torch.zeros(4, 6), torch.zeros(4, 2), torch.zeros(4, 3), target([0] * 4, [0] * 4, [0]))
    assert torch.isfinite(terms.total())
    assert float(terms.type) == pytest.approx(math.log(6), rel=1e-5)


def test_the_weight_of_edge_points_is_a_setting():
    """Lambda 1 is the plain pull."""
    descriptors = torch.tensor([[0.0, 0], [4, 0]])
    pull, _ = embedding_loss(descriptors, target([0, 0], [0, 1], [0]), edge_weight=1.0)
    assert float(pull) == pytest.approx(1.5, rel=1e-4)
