"""The random choices of a part: one generator, asked in plain words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


class Dice:
    """Random numbers from a seed of one or more whole numbers; the same seed gives the same numbers.

    Two of them hold for a whole part: `conical`, whether its holes and round edges have bevels, countersinks and
    drill tips, and `rounded`, whether it has fillets.
    """

    def __init__(self, *seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self.conical = self.chance(0.2)
        self.rounded = self.chance(0.44)

    def chance(self, probability: float) -> bool:
        return bool(self._rng.random() < probability)

    def between(self, low: float, high: float) -> float:
        """Uniform."""
        return float(self._rng.uniform(low, high))

    def spread(self, low: float, high: float) -> float:
        """Uniform in the logarithm: as often between 1 and 2 as between 10 and 20."""
        return float(np.exp(self._rng.uniform(np.log(low), np.log(high))))

    def whole(self, low: int, high: int) -> int:
        """A whole number from low to high, both included."""
        return int(self._rng.integers(low, high + 1))

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of the options, by their weights."""
        shares = None if weights is None else np.array(weights) / np.sum(weights)
        return options[int(self._rng.choice(len(options), p=shares))]

    def some(self, options: Sequence[T], most: int) -> list[T]:
        """One to `most` of the options, in their order."""
        count = self.whole(1, max(1, min(most, len(options))))
        return [options[k] for k in sorted(self._rng.choice(len(options), min(count, len(options)), replace=False))]
