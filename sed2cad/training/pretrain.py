"""The point-wise local network is trained first, alone, on points shuffled over many clouds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from sed2cad.network.features import local_features
from sed2cad.network.sednet import LocalNet
from sed2cad.network.types import PATCH_TYPES
from sed2cad.training.augment import random_motion
from sed2cad.training.samples import load_sample

_KEY = 0  # of the samples
ROWS = 1_200
"""Points per cloud."""
BATCH = 4_096
LEARNING_RATE = 3e-3


def pretrain_local(local: LocalNet, parts: Sequence[Path], steps: int, rng: np.random.Generator) -> float:
    """Train on type and edge of single points, set the standardisation; returns the last type accuracy."""
    features, types, edges = _points_of(parts, rng)
    local.mean.copy_(features.mean(0))
    local.deviation.copy_(features.std(0) + 1e-6)
    local.requires_grad_(True)
    optimizer = torch.optim.AdamW(local.parameters(), LEARNING_RATE)
    right = 0.0
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = LEARNING_RATE * 0.5 * (1 + math.cos(math.pi * step / steps)) + 1e-5
        rows = torch.from_numpy(rng.integers(0, len(features), BATCH))
        logits = local(features[rows])
        type_, edge = logits[:, : len(PATCH_TYPES)], logits[:, len(PATCH_TYPES) :]
        loss = functional.cross_entropy(type_, types[rows]) + functional.cross_entropy(edge, edges[rows])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        hit = float((type_.argmax(1) == types[rows]).float().mean())
        right = hit if step == 0 else 0.98 * right + 0.02 * hit
    local.requires_grad_(False)
    return right


def _points_of(parts: Sequence[Path], rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Features (n, 58), types and edges of some points of a cloud of every part, clean or not."""
    features, types, edges = [], [], []
    for path in parts:
        sample = load_sample(path, (_KEY,), ROWS)
        motion = random_motion(rng)
        normals = sample.normals @ motion.T
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        features.append(local_features(sample.points @ motion.T, normals, sample.neighbours[:, :ROWS]))
        types.append(sample.type[:ROWS])
        edges.append(sample.edge)
    return (
        torch.from_numpy(np.concatenate(features)),
        torch.from_numpy(np.concatenate(types)).long(),
        torch.from_numpy(np.concatenate(edges)).long(),
    )
