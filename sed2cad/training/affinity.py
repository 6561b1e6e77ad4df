"""Train the pair network: are two neighbouring points on one patch?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from sed2cad.network.affinity import PairNet
from sed2cad.network.features import PAIR_NEIGHBOURS, local_features, pair_features
from sed2cad.training.samples import load_sample

WIDTH = 128
_KEY = 1  # of the samples, other than those of the local network
PAIRS = 1_400
"""Pairs per part."""
BATCH = 4_096
LEARNING_RATE = 3e-3


def train_affinity(parts: Sequence[Path], steps: int = 2_000, seed: int = 0) -> PairNet:
    """A pair network trained on some pairs of a cloud of every part, clean or not."""
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    pairs, same = _pairs_of(parts, rng)
    network = PairNet(WIDTH)
    network.mean.copy_(pairs.mean(0))
    network.deviation.copy_(pairs.std(0) + 1e-6)
    optimizer = torch.optim.AdamW(network.parameters(), LEARNING_RATE)
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = LEARNING_RATE * 0.5 * (1 + math.cos(math.pi * step / steps)) + 1e-5
        rows = torch.from_numpy(rng.integers(0, len(pairs), BATCH))
        loss = functional.binary_cross_entropy_with_logits(network(pairs[rows]), same[rows])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return network.requires_grad_(False)


def _pairs_of(parts: Sequence[Path], rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Pair features (m, 77) and truth (m,) of random pairs."""
    pairs, same = [], []
    for path in parts:
        sample = load_sample(path, (_KEY,), 0)
        n, count = len(sample.points), min(PAIRS, len(sample.points))
        i = rng.integers(0, n, count)
        j = sample.neighbours[0, i, rng.integers(1, PAIR_NEIGHBOURS + 1, count)].astype(np.int64)
        pairs.append(pair_features(local_features(sample.points, sample.normals, sample.neighbours), i, j))
        same.append(sample.patch[i] == sample.patch[j])
    return torch.from_numpy(np.concatenate(pairs)), torch.from_numpy(np.concatenate(same)).float()
