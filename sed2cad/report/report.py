"""What the user is told about a reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sed2cad.brep.attempt import AssemblyResult


@dataclass(frozen=True)
class Deviation:
    """Distance from the scan's points to the solid, in the scan's unit."""

    rms: float
    p95: float
    max: float


@dataclass(frozen=True)
class FaceSummary:
    """One face of the solid."""

    name: str  # of the primitive that carries it
    rung: str  # how the face was made: "exact", "swept", "bspline", "freeform" (in place of an exact one), "facets"
    deviation: float  # rms distance of its points, in the scan's unit


@dataclass(frozen=True)
class Report:
    """How the solid was made and how good it is."""

    closed: bool
    rung: str  # of the ladder: which attempt passed the gate
    reason: str  # why the better rungs failed; empty when the first passed
    faces: int
    exact_faces: int
    volume: float  # unit^3
    deviation: Deviation
    face_list: tuple[FaceSummary, ...] = ()
    constraints: tuple[str, ...] = ()  # "cylinder_1 coaxial cylinder_2 (0.013 deg)"
    seconds: tuple[tuple[str, float], ...] = ()  # per stage
    warnings: tuple[str, ...] = field(default=())

    def for_variant(self, solid: AssemblyResult) -> Report:
        """The report of a variant: what was measured on the scan no longer holds, what was built does."""
        unknown = Deviation(float("nan"), float("nan"), float("nan"))
        return replace(
            self, closed=solid.gate.passed, rung="variant", reason="", volume=solid.gate.volume,
            deviation=unknown, seconds=(), warnings=("a variant: it was not compared with the scan",),
        )
