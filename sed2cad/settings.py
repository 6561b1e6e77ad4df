"""What a reconstruction can be told."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sed2cad.errors import UsageError

UNITS = ("mm", "cm", "m", "in")


@dataclass(frozen=True)
class Settings:
    """Options of `reconstruct`; UsageError for values that make no sense."""

    seed: int = 0
    regularize: bool = True  # whether what is nearly parallel, coaxial, equal, ... becomes exactly so
    round: float | None = None  # dimensions become multiples of it where the points allow, in `unit`; None: they do not
    tolerance: float | None = None  # largest distance of points and their faces, in `unit`; None: from the noise
    cap: bool = False  # whether flat faces close the part where the scan ends; without, the shell stays open there
    unit: str = "mm"  # of the scan's coordinates: "mm", "cm", "m", "in"
    exact_seconds: float = 20.0  # of assembly, after which no further attempt at an exact solid is begun
    solid_seconds: float = 32.0  # of assembly, after which no face is replaced any more and the solid is made of facets
    attempt_seconds: float = 30.0  # for one attempt to build the solid; the CAD kernel hangs now and then

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise UsageError(f"unknown unit {self.unit!r}: it must be one of {', '.join(UNITS)}")
        if self.tolerance is not None and not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise UsageError(f"the tolerance is {self.tolerance}: it must be a length above 0")
        if self.round is not None and not (math.isfinite(self.round) and self.round > 0):
            raise UsageError(f"the step of rounding is {self.round}: it must be a length above 0")
        if self.round is not None and not self.regularize:
            raise UsageError("raw fits cannot be rounded: choose --round or --no-regularize")
        if not 0 <= self.seed < 2**32:
            raise UsageError(f"the seed is {self.seed}: it must be between 0 and {2**32 - 1}")
        if not self.attempt_seconds > 0:
            raise UsageError(f"the time limit is {self.attempt_seconds} s: it must be above 0")
