"""Minimum cuts and alpha-expansion against brute force."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from sed2cad.topology.mincut import alpha_expansion, energy, min_cut


def graph(seed: int, nodes: int) -> tuple[np.random.Generator, np.ndarray]:
    rng = np.random.default_rng(seed)
    pairs = [(i, j) for i in range(nodes) for j in range(i) if rng.random() < 0.5]
    return rng, np.array(pairs, dtype=np.int64).reshape(-1, 2)


@pytest.mark.parametrize("seed", range(10))
def test_min_cut_is_the_cheapest(seed):
    rng, pairs = graph(seed, 7)
    source, sink = rng.random((2, 7)) * 3
    forward, backward = rng.random((2, len(pairs)))

    def cost(at_sink: np.ndarray) -> float:
        a, b = at_sink[pairs[:, 0]], at_sink[pairs[:, 1]]
        return np.where(at_sink, sink, source).sum() + forward[~a & b].sum() + backward[a & ~b].sum()

    best = min(cost(np.array(sides)) for sides in product([False, True], repeat=7))
    assert cost(min_cut(source, sink, pairs, forward, backward)) == pytest.approx(best, abs=0.02)


@pytest.mark.parametrize("seed", range(10))
def test_expansion_of_two_labels_is_exact(seed):
    rng, pairs = graph(seed, 7)
    costs, weights = rng.random((7, 2)) * 3, rng.random(len(pairs)) * 2
    best = min(energy(costs, pairs, weights, np.array(f)) for f in product(range(2), repeat=7))
    assert energy(costs, pairs, weights, alpha_expansion(costs, pairs, weights)) == pytest.approx(
        best, abs=0.02
    )


@pytest.mark.parametrize("seed", range(10))
def test_expansion_of_three_labels_is_within_its_bound(seed):
    rng, pairs = graph(seed, 6)
    costs, weights = rng.random((6, 3)) * 3, rng.random(len(pairs)) * 2
    best = min(energy(costs, pairs, weights, np.array(f)) for f in product(range(3), repeat=6))
    assert energy(costs, pairs, weights, alpha_expansion(costs, pairs, weights)) <= 2 * best + 0.02


def test_a_label_that_is_no_candidate_is_never_taken():
    costs = np.array([[0.0, np.inf], [5.0, 0.0], [0.0, np.inf]])
    pairs = np.array([[0, 1], [1, 2]])
    assert alpha_expansion(costs, pairs, np.array([0.1, 0.1])).tolist() == [0, 1, 0]
    assert alpha_expansion(costs, pairs, np.array([9.0, 9.0])).tolist() == [0, 0, 0]
