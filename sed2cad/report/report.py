"""What the user is told about a reconstruction."""

from __future__ import annotations

from collections.abc import Collection
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
class Boundary:
    """Where an open shell ends."""

    faces: tuple[str, ...]  # names of the primitives along it
    length: float  # in the scan's unit
    centre: tuple[float, float, float]  # of its corners' box, scan's unit and frame

    def __str__(self) -> str:
        """"around (0, 0, -24), 318 long, along plane_1, cylinder_3"."""
        place = ", ".join(f"{x:.4g}" for x in self.centre)
        return f"around ({place}), {self.length:.4g} long, along {', '.join(self.faces)}"


@dataclass(frozen=True)
class ConstraintSummary:
    """What was made exact. Lengths in the scan's unit, angles in degrees."""

    kind: str  # as in constraints.Constraint
    faces: tuple[str, ...]  # names of the primitives
    off: float  # by how much it did not hold before
    angular: bool  # whether `off` and the values are angles
    measure: str = ""  # of a dimension: radius, distance, half_angle, ...
    before: float | None = None  # value of the dimension without this constraint
    after: float | None = None
    detail: str = ""  # of a pattern: "every 60 degrees"

    def __str__(self) -> str:
        """"coaxial: cylinder_1, cylinder_2 (was off by 0.013)"."""
        unit = " degrees" if self.angular else ""
        change = f"was off by {self.off:.3g}{unit}"
        if self.before is not None and self.after is not None:
            change = f"{self.measure.replace('_', ' ')} {self.before:.6g} to {self.after:.6g}{unit}"
        told = f"{self.detail}, {change}" if self.detail else change
        return f"{self.kind.replace('_', ' ')}: {', '.join(self.faces)} ({told})"


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
    constraints: tuple[ConstraintSummary, ...] = ()
    seconds: tuple[tuple[str, float], ...] = ()  # per stage
    warnings: tuple[str, ...] = field(default=())
    boundaries: tuple[Boundary, ...] = ()  # of an open shell

    def for_variant(self, solid: AssemblyResult, changed: Collection[str]) -> Report:
        """The report of a variant: what was measured on the scan no longer holds, what was built does.

        Nor is anything claimed between the changed primitives, given by name, and others.
        """
        unknown = Deviation(float("nan"), float("nan"), float("nan"))
        return replace(
            self, closed=solid.gate.closed, rung="variant", reason="", volume=solid.gate.volume,
            constraints=tuple(c for c in self.constraints if not set(changed) & set(c.faces)),
            deviation=unknown, seconds=(), warnings=("a variant: it was not compared with the scan",),
        )
