"""One attempt at a solid: exact surfaces on a traced topology, or facets. Run it in a worker (worker.py)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sed2cad.brep.bodies import BodyShape, Joined, cavities, join
from sed2cad.brep.faceted import faceted_bodies
from sed2cad.brep.fix import VARIANTS, Variant, fix
from sed2cad.brep.gate import Checked, Expected, GateResult, Limits, check
from sed2cad.brep.kernel import Array, to_bytes
from sed2cad.brep.solid import build_bodies
from sed2cad.errors import AssemblyError
from sed2cad.geometry.extend import widened
from sed2cad.geometry.layout import Draft
from sed2cad.geometry.realise import realise
from sed2cad.geometry.seams import place
from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.scan.scan import Frame, Mesh
from sed2cad.topology.model import Topology

_MOST_POINTS = 5000  # that a solid is judged by

Rung = Literal["exact", "bspline", "facets"]


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


@dataclass(frozen=True)
class FacetedAttempt:
    """A closed mesh to be taken as it is. Unit frame."""

    mesh: Mesh
    frame: Frame
    points: Array  # (n, 3)
    options: Options = field(default_factory=Options)


@dataclass(frozen=True)
class FaceReport:
    """One face of the solid."""

    region: int  # of the topology; -1 for facets
    primitive: int  # index into `fitted`; -1 for facets
    kind: str  # "plane", "cylinder", ..., "bspline", "facet"
    rung: Rung  # how exact the face is
    deviation: float  # rms distance of its points, world units; NaN where it has none


@dataclass(frozen=True)
class AssemblyResult:
    """A solid in world coordinates and what is known about it."""

    brep: bytes  # see kernel.from_bytes
    faces: tuple[FaceReport, ...]  # in the order of the solid's faces
    gate: GateResult
    variant: str  # of the repair; "facets" for a faceted solid

    @property
    def exact(self) -> bool:
        """Whether every face lies on a plane, cylinder, cone, sphere or torus."""
        return all(face.rung == "exact" for face in self.faces)


def assemble(attempt: Attempt) -> AssemblyResult:
    """Corners, edges, faces, shells, solids; repaired until the kernel is content; judged by the gate.

    AssemblyError where a face is open or nothing can be built.
    """
    topology, frame = attempt.topology, attempt.frame
    fitted = [widened(patch) for patch in attempt.fitted]
    draft = Draft(realise(topology, fitted), fitted)
    layout = place(draft).in_world(frame)
    hollow = cavities(layout, [region.area for region in topology.regions])
    bodies = build_bodies(layout)
    best: tuple[int, AssemblyResult] | None = None
    for variant in attempt.options.variants:
        repaired = [fix(body, frame.scale, variant) for body in bodies]
        faults = sum(fixed.faults for fixed in repaired)
        if best is not None and faults >= best[0] > 0:
            continue
        shapes = [BodyShape(f.solid, f.regions, hollow[k]) for f, k in zip(repaired, sorted(hollow))]
        result = _judged(attempt, join(shapes), variant)
        if result.gate.passed:
            return result
        if best is None or faults < best[0]:
            best = faults, result
    if best is None:
        raise AssemblyError("no repair of the solid was asked for")
    return best[1]


def _judged(attempt: Attempt, joined: Joined, variant: Variant) -> AssemblyResult:
    """The gate's verdict on one repair."""
    topology, frame = attempt.topology, attempt.frame
    primitive_of = [region.primitive for region in topology.regions]
    numbers = [primitive_of[r] if r >= 0 else -1 for r in joined.regions]
    world: list[Primitive | None] = [
        attempt.fitted[k].primitive.scaled(frame.scale, frame.origin) if k >= 0 else None for k in numbers
    ]
    volume = topology.volume * frame.scale**3
    expected = Expected(
        joined.solids, volume, _judges(attempt.points, frame), frame.to_world(attempt.surface), frame.scale
    )
    checked = check(joined.shape, world, expected, attempt.options.limits)
    reports = _reports(joined, numbers, world, checked)
    return AssemblyResult(to_bytes(joined.shape), reports, checked.result, variant)


def assemble_faceted(attempt: FacetedAttempt) -> AssemblyResult:
    """The closed mesh as a solid of planar faces: the last rung of the ladder."""
    frame = attempt.frame
    mesh = Mesh(frame.to_world(attempt.mesh.vertices), attempt.mesh.faces)
    joined = join(faceted_bodies(mesh, frame.scale, attempt.options.merge_facets))
    nothing: list[Primitive | None] = [None] * len(joined.regions)
    expected = Expected(joined.solids, mesh.volume(), _judges(attempt.points, frame), nowhere(), frame.scale)
    checked = check(joined.shape, nothing, expected, attempt.options.limits)
    reports = _reports(joined, [-1] * len(nothing), nothing, checked)
    return AssemblyResult(to_bytes(joined.shape), reports, checked.result, "facets")


def _judges(points: Array, frame: Frame) -> Array:
    """Points spread over the scan in its order, world coordinates."""
    step = max(1, -(-len(points) // _MOST_POINTS))
    return frame.to_world(points[::step])


def _reports(
    joined: Joined, numbers: Sequence[int], primitives: Sequence[Primitive | None], checked: Checked
) -> tuple[FaceReport, ...]:
    """One report per face."""
    count = len(joined.regions)
    spread = np.full(count, math.nan)
    if checked.deviations is not None:
        spread = checked.deviations.rms_by_face(count)
    return tuple(
        FaceReport(
            region,
            number,
            primitive.kind if primitive is not None else "facet",
            _rung(primitive),
            float(rms),
        )
        for region, number, primitive, rms in zip(joined.regions, numbers, primitives, spread)
    )


def _rung(primitive: Primitive | None) -> Rung:
    if primitive is None:
        return "facets"
    return "bspline" if primitive.kind == "bspline" else "exact"
