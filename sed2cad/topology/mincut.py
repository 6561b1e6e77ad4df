"""Minimum cuts and alpha-expansion (Boykov, Veksler and Zabih 2001) on SciPy's maximum flow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

Array = NDArray[np.float64]
Labels = NDArray[np.int64]
Pairs = NDArray[np.int64]
Mask = NDArray[np.bool_]

_UNITS = 1000.0  # capacities are integers: this many to a cost of 1
_LARGEST = 100_000.0  # a cost above this counts as this: sums must stay in 32 bits


def min_cut(if_source: Array, if_sink: Array, pairs: Pairs, forward: Array, backward: Array) -> Mask:
    """Which of n nodes (n,) are on the sink's side of the cheapest cut.

    if_source, if_sink (n,): cost of being on either side. forward (m,): cost of pairs[:, 0] at the source
    with pairs[:, 1] at the sink; backward (m,): the reverse. All costs >= 0.
    """
    count = len(if_source)
    source, sink, nodes = count, count + 1, np.arange(count)
    base = np.minimum(if_source, if_sink)
    rows = np.concatenate([np.full(count, source), nodes, pairs[:, 0], pairs[:, 1]])
    columns = np.concatenate([nodes, np.full(count, sink), pairs[:, 1], pairs[:, 0]])
    costs = np.concatenate([if_sink - base, if_source - base, forward, backward])
    capacity = np.rint(np.minimum(costs, _LARGEST) * _UNITS).astype(np.int32)
    graph = csr_matrix((capacity, (rows, columns)), shape=(count + 2, count + 2))
    residual = graph - maximum_flow(graph, source, sink).flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    at_sink = np.ones(count + 2, dtype=bool)
    at_sink[breadth_first_order(residual, source, return_predecessors=False)] = False
    return np.asarray(at_sink[:count])


def energy(costs: Array, pairs: Pairs, weights: Array, labels: Labels) -> float:
    """sum_i costs[i, label_i] + sum_ij weights_ij [label_i != label_j]."""
    data = costs[np.arange(len(labels)), labels].sum()
    return float(data + weights[labels[pairs[:, 0]] != labels[pairs[:, 1]]].sum())


def alpha_expansion(
    costs: Array, pairs: Pairs, weights: Array, labels: Labels | None = None, rounds: int = 4
) -> Labels:
    """Labels (n,) of low Potts energy.

    costs (n, k): inf where a label is no candidate; pairs (m, 2) with weights (m,) >= 0; starts at the
    cheapest labels. Each move offers one label to all nodes that may take it; a move
    that does not gain is dropped.
    """
    labels = costs.argmin(axis=1).astype(np.int64) if labels is None else labels.copy()
    best = energy(costs, pairs, weights, labels)
    idle = 0
    for turn in range(rounds * costs.shape[1]):
        alpha = turn % costs.shape[1]
        moved = _expanded(costs, pairs, weights, labels, alpha)
        value = energy(costs, pairs, weights, moved) if moved is not None else best
        if moved is not None and value < best - 1e-9:
            labels, best, idle = moved, value, 0
        else:
            idle += 1
        if idle >= costs.shape[1]:
            break
    return labels


def _expanded(costs: Array, pairs: Pairs, weights: Array, labels: Labels, alpha: int) -> Labels | None:
    """The best labels in which any node has either kept its label or taken alpha; None where none may."""
    active = np.isfinite(costs[:, alpha]) & (labels != alpha)
    count = int(active.sum())
    if count == 0:
        return None
    place = np.full(len(labels), -1)
    place[active] = np.arange(count)
    at = place[pairs]
    near = np.flatnonzero((at >= 0).any(axis=1))
    at, sides, weight = at[near], labels[pairs[near]], weights[near]
    keep, take = costs[active, labels[active]].copy(), costs[active, alpha].copy()
    for mine, theirs in ((0, 1), (1, 0)):
        border = (at[:, mine] >= 0) & (at[:, theirs] < 0)
        node, own, other, cost = at[border, mine], sides[border, mine], sides[border, theirs], weight[border]
        np.add.at(keep, node, cost * (own != other))
        np.add.at(take, node, cost * (other != alpha))
    inner = (at >= 0).all(axis=1)
    at, cost = at[inner], weight[inner]
    apart = cost * (sides[inner, 0] != sides[inner, 1])  # both keep: moved to the first node and the pair
    np.add.at(keep, at[:, 0], apart)
    switched = min_cut(keep, take, at, cost, cost - apart)
    moved = labels.copy()
    moved[np.flatnonzero(active)[switched]] = alpha
    return moved
