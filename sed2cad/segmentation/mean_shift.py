"""Descriptors to clusters: mean shift; and clusters without crumbs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

Array = NDArray[np.float32]

SAMPLE = 2_500
"""The density is estimated from this many points."""
CONVERGED = 1e-4
"""Squared length of the longest step at which the shift stops."""


def mean_shift(
    descriptors: NDArray,
    bandwidth: float = 0.3,
    seeds: int = 1_000,
    iterations: int = 8,
    seed: int = 0,
) -> NDArray[np.int64]:
    """Cluster descriptors (n, d) with a Gaussian kernel (Comaniciu and Meer 2002); labels (n,) from 0.

    Random seeds climb the density of a random sample; modes nearer than twice the bandwidth are one, the
    denser one stays; every point goes to its nearest mode.
    """
    rng = np.random.default_rng(seed)
    every = np.ascontiguousarray(descriptors, np.float32)
    sample = every[rng.permutation(len(every))[:SAMPLE]]
    modes = every[rng.permutation(len(every))[:seeds]]
    for _ in range(iterations):
        weights = _kernel(modes, sample, bandwidth)
        density = weights.sum(axis=1)
        shifted = weights @ sample / np.maximum(density, 1e-12)[:, None]
        step = ((shifted - modes) ** 2).sum(axis=1).max()
        modes = shifted
        if step < CONVERGED:
            break
    modes = _distinct(modes[np.argsort(-density)], 2 * bandwidth)
    nearest = ((modes**2).sum(axis=1) - 2 * every @ modes.T).argmin(axis=1)
    return np.unique(nearest, return_inverse=True)[1]


def absorb_small(
    labels: NDArray, neighbours: NDArray, minimum: int = 10, rounds: int = 8
) -> NDArray[np.int64]:
    """Give points of patches below `minimum` points to the patch most frequent among their neighbours."""
    labels = np.unique(labels, return_inverse=True)[1]
    small = np.bincount(labels)[labels] < minimum
    labels = np.where(small, -1, labels)
    for _ in range(rounds):
        open_ = np.flatnonzero(labels < 0)
        around = labels[neighbours[open_]]
        votes = np.where(around >= 0, (around[:, :, None] == around[:, None, :]).sum(2), 0)
        best = votes.argmax(1)
        found = votes[np.arange(len(open_)), best] > 0
        if not found.any():
            break
        labels[open_[found]] = around[found, best[found]]
    left = labels < 0  # islands without any large patch near: one patch
    labels[left] = labels.max() + 1
    return np.unique(labels, return_inverse=True)[1]


def _kernel(a: Array, b: Array, bandwidth: float) -> Array:
    """exp(-|a_i - b_j|^2 / 2 h^2), (len(a), len(b))."""
    exponent = a @ b.T
    exponent -= 0.5 * (a**2).sum(axis=1)[:, None]
    exponent -= 0.5 * (b**2).sum(axis=1)
    exponent /= bandwidth**2
    np.minimum(exponent, 0, out=exponent)
    return np.exp(exponent, out=exponent)


def _distinct(modes: Array, radius: float) -> Array:
    """Keep the modes, densest first, that are farther than `radius` from every one kept before."""
    near = cdist(modes, modes) <= radius
    left, kept = np.ones(len(modes), bool), []
    while left.any():
        first = int(left.argmax())
        kept.append(first)
        left &= ~near[first]
    return modes[kept]
