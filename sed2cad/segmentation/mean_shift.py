"""Descriptors to clusters: mean shift; and clusters without crumbs."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

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
    every = torch.from_numpy(np.ascontiguousarray(descriptors, np.float32))
    sample = every[torch.from_numpy(rng.permutation(len(every))[:SAMPLE])]
    modes = every[torch.from_numpy(rng.permutation(len(every))[:seeds])]
    with torch.no_grad():
        for _ in range(iterations):
            weights = _kernel(modes, sample, bandwidth)
            density = weights.sum(1, keepdim=True)
            shifted = weights @ sample / density.clamp_min(1e-12)
            step = (shifted - modes).square().sum(1).max()
            modes = shifted
            if step < CONVERGED:
                break
        modes = _distinct(modes[density[:, 0].argsort(descending=True)], 2 * bandwidth)
        nearest = ((modes * modes).sum(1) - 2 * every @ modes.T).argmin(1)
    return np.unique(nearest.numpy(), return_inverse=True)[1]


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


def _kernel(a: Tensor, b: Tensor, bandwidth: float) -> Tensor:
    """exp(-|a_i - b_j|^2 / 2 h^2), (len(a), len(b))."""
    d2 = (a * a).sum(1, keepdim=True) + (b * b).sum(1) - 2 * a @ b.T
    return d2.clamp_min_(0).mul_(-0.5 / bandwidth**2).exp_()


def _distinct(modes: Tensor, radius: float) -> Tensor:
    """Keep the modes, densest first, that are farther than `radius` from every one kept before."""
    near = torch.cdist(modes, modes) <= radius
    left, kept = torch.ones(len(modes), dtype=torch.bool), []
    while left.any():
        first = int(left.int().argmax())
        kept.append(first)
        left &= ~near[first]
    return modes[kept]
