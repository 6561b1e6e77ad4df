"""An attempt at a solid and what comes of it: what asker and worker tell each other. The kernel is not loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from sed2cad.geometry.polygons import Cloud
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.loose import loose_patch
from sed2cad.scan.scan import Array, Frame, Mesh
from sed2cad.topology.model import Topology

Variant = Literal["full", "min", "min+", "loose"]
VARIANTS: tuple[Variant, ...] = ("full", "min", "min+", "loose")
# swept: extrusion or revolution; freeform: in place of an exact face that failed
Rung = Literal["exact", "swept", "bspline", "freeform", "facets"]


@dataclass(frozen=True)
class Limits:
    """What passes."""

    volume: float = 0.05  # relative difference from the proxy's volume
    distance: float = 0.01  # of the diagonal: a point this near to the solid is explained
    coverage: float = 0.98  # share of the points that must be explained
    stray: float = 0.03  # of the diagonal: nothing of the solid may be farther from the scan and its proxy
    tolerance: float = 0.01  # of the diagonal: largest tolerance of an edge or vertex


@dataclass(frozen=True)
class Options:
    """How an attempt is made and judged."""

    variants: tuple[Variant, ...] = VARIANTS  # of the repair, in the order they are tried
    limits: Limits = field(default_factory=Limits)
    merge_facets: bool = True  # whether coplanar triangles become one face


def nowhere() -> Array:
    """No points (0, 3): what is not to be judged."""
    return np.zeros((0, 3))


@dataclass(frozen=True)
class Attempt:
    """Everything an attempt needs. Unit frame."""

    topology: Topology
    fitted: tuple[FittedPatch, ...]
    frame: Frame
    points: Array  # (n, 3): a sample of the scan to judge by; none: the distance is not judged
    options: Options = field(default_factory=Options)
    surface: Array = field(default_factory=nowhere)  # (m, 3): scan and proxy, near which the solid must be
    freeform: frozenset[int] = frozenset()  # primitives that stand in for an exact one that failed
    facets: Mapping[int, Cloud] = field(default_factory=dict)  # regions to be made of facets that follow a cloud

    def cloud(self, number: int) -> Cloud:
        """The points of a region and the normals of its surface there."""
        region = self.topology.regions[number]
        patch = self.fitted[region.primitive]
        return Cloud(region.points, patch.sign * patch.primitive.normal(region.points))

    def loosened(self) -> Attempt:
        """The attempt with no surface under the regions that are to be facets."""
        if not self.facets:
            return self
        number = len(self.fitted)
        regions = tuple(
            replace(region, primitive=number) if r in self.facets else region
            for r, region in enumerate(self.topology.regions)
        )
        return replace(self, topology=replace(self.topology, regions=regions), fitted=(*self.fitted, loose_patch()))


@dataclass(frozen=True)
class FacetedAttempt:
    """A closed mesh to be taken as it is. Unit frame."""

    mesh: Mesh
    frame: Frame
    points: Array  # (n, 3)
    options: Options = field(default_factory=Options)


@dataclass(frozen=True)
class GateResult:
    """What was found. Lengths in world units; NaN where it was not measured."""

    passed: bool
    reason: str  # why it did not pass, one clause for a machinist; empty when it did
    solids: int
    closed: bool
    valid: bool
    volume: float
    volume_ratio: float  # to the proxy's
    coverage: float  # share of the points within the distance limit
    rms: float  # of the points' distances
    p95: float
    max: float
    stray: float  # largest distance of the solid from the scan and its proxy
    max_tolerance: float
    step_valid: bool  # still valid after writing and reading the STEP file
    undrawn: int = 0  # faces that cannot be drawn; looked for when all else is well


@dataclass(frozen=True)
class FaceReport:
    """One face of the solid."""

    region: int  # of the topology; -1 for facets
    primitive: int  # index into `fitted`; -1 for facets
    kind: str  # "plane", "cylinder", ..., "bspline", "extrusion", "revolution", "facet"
    rung: Rung  # how exact the face is
    deviation: float  # rms distance of its points, world units; NaN where it has none


@dataclass(frozen=True)
class AssemblyResult:
    """A solid in world coordinates and what is known about it."""

    brep: bytes  # see kernel.from_bytes
    faces: tuple[FaceReport, ...]  # in the order of the solid's faces
    gate: GateResult
    variant: str  # of the repair; "facets" for a faceted solid
    blamed: tuple[int, ...] = ()  # regions whose faces kept it from passing the gate, as far as that is known

    @property
    def exact(self) -> bool:
        """Whether every face lies on a plane, cylinder, cone, sphere or torus."""
        return all(face.rung == "exact" for face in self.faces)


@dataclass(frozen=True)
class Verdict:
    """What came of an attempt, and who is to blame if it was not good enough."""

    result: AssemblyResult | None
    reason: str  # empty when it passed the gate
    blamed: tuple[int, ...]  # regions; none: nobody knows


@dataclass(frozen=True)
class Opening:
    """A solid and the numbers of the faces that it is to lose."""

    solid: AssemblyResult
    faces: frozenset[int]


@dataclass(frozen=True)
class Export:
    """A solid and what its STEP file says about it."""

    brep: bytes
    face_names: tuple[str, ...]
    product: str
    unit: str  # of the coordinates
