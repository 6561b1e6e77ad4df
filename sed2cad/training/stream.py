"""The order in which samples come, and batches of them; all of it follows from the seed and the step."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from sed2cad.network.batch import Batch, stack
from sed2cad.network.graph import Cloud
from sed2cad.training.augment import random_motion
from sed2cad.training.losses import Target
from sed2cad.training.samples import Sample, load_sample
from sed2cad.training.settings import TrainSettings

BLOCK = 32
"""So many samples are held to be used again before the next ones are drawn."""


class Stream:
    """Samples of the parts for one of `size` processes: every epoch draws every part once over all processes.

    Each sample is drawn once and used `reuse` times, in different orders, within a block.
    """

    def __init__(self, parts: Sequence[Path], settings: TrainSettings, rank: int = 0, size: int = 1) -> None:
        self.parts, self.settings, self.rank, self.size = parts, settings, rank, size
        self.seed, self.reuse = settings.seed, settings.reuse
        self._held: OrderedDict[int, Sample] = OrderedDict()

    def samples(self, step: int, batch: int) -> list[Sample]:
        """The samples of a step."""
        return [self._sample(self._number(place)) for place in range(step * batch, (step + 1) * batch)]

    def _number(self, place: int) -> int:
        """Which sample comes at a place in the stream."""
        block, within = divmod(place, BLOCK * self.reuse)
        use, index = divmod(within, BLOCK)
        order = np.random.default_rng([self.seed, block, use]).permutation(BLOCK)
        return (block * BLOCK + int(order[index])) * self.size + self.rank

    def _sample(self, number: int) -> Sample:
        if number not in self._held:
            epoch, index = divmod(number, len(self.parts))
            part = np.random.default_rng([self.seed, epoch]).permutation(len(self.parts))[index]
            rows, clean, points = self.settings.rows, self.settings.clean, self.settings.points
            self._held[number] = load_sample(self.parts[part], (self.seed, epoch), rows, clean, points)
            if len(self._held) > BLOCK:
                self._held.popitem(last=False)
        return self._held[number]


def make_batch(
    samples: Sequence[Sample], rows: int, rng: np.random.Generator, torus: bool = True
) -> tuple[Batch, Target]:
    """Move each sample at random and stack them; the target of their first `rows` points.

    The types are those of PATCH_TYPES, without `torus` those of PAPER_TYPES.
    """
    rows = min(rows, *(len(sample.edge) for sample in samples))
    clouds, patches, owners, count = [], [], [], 0
    for index, sample in enumerate(samples):
        motion = random_motion(rng)
        normals = sample.normals @ motion.T
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        clouds.append(Cloud(sample.points @ motion.T, normals, sample.neighbours))
        names, patch = np.unique(sample.patch[:rows], return_inverse=True)
        patches.append(patch + count)
        owners.append(np.full(len(names), index))
        count += len(names)
    target = Target(
        _long([(sample.type if torus else sample.paper_type)[:rows] for sample in samples]),
        _long([sample.edge[:rows] for sample in samples]),
        _long(patches),
        _long(owners),
    )
    return stack(clouds, rows), target


def _long(arrays: Sequence[np.ndarray]) -> torch.Tensor:
    return torch.from_numpy(np.concatenate(arrays).astype(np.int64))
