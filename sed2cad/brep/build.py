"""An attempt is made: exact surfaces on a traced topology, or facets. Ask for it through jobs.py."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sed2cad.brep.attempt import (
    AssemblyResult,
    Attempt,
    FaceReport,
    FacetedAttempt,
    Rung,
    Variant,
    Verdict,
    nowhere,
)
from sed2cad.brep.blame import at_worst_edge, to_blame
from sed2cad.brep.bodies import BodyShape, Joined, cavities, join
from sed2cad.brep.faceted import faceted_bodies
from sed2cad.brep.fix import fix
from sed2cad.brep.gate import Checked, Expected, check
from sed2cad.brep.kernel import Array, to_bytes
from sed2cad.brep.solid import build_bodies
from sed2cad.errors import AssemblyError
from sed2cad.geometry.extend import widened
from sed2cad.geometry.facets import faceted, is_loose
from sed2cad.geometry.folding import fold
from sed2cad.geometry.layout import Draft
from sed2cad.geometry.realise import realise
from sed2cad.geometry.seams import OpenFace, place
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.registry import SWEPT_KINDS
from sed2cad.scan.scan import Frame, Mesh

_MOST_POINTS = 5000  # that a solid is judged by
_SMALL = 0.01  # share of the surface


def assemble(attempt: Attempt) -> AssemblyResult:
    """Corners, edges, faces, shells, solids; repaired until the kernel is content; judged by the gate.

    Where faces cannot be drawn because their edges cross beside the corners, all edges are bent to end there. A small
    freeform face that goes around its axis and is open on one side becomes facets. AssemblyError where another face is
    open or nothing can be built.
    """
    try:
        return _assembled_straight_or_bent(attempt.loosened())
    except OpenFace as error:
        if not all(_is_small_freeform(attempt, region) for region in error.regions):
            raise
        facets = {region: attempt.cloud(region) for region in error.regions}
        return assemble(replace(attempt, facets={**attempt.facets, **facets}))


def _is_small_freeform(attempt: Attempt, number: int) -> bool:
    """Whether a region is one that facets stand for as well as any surface."""
    regions = attempt.topology.regions
    small = regions[number].area < _SMALL * sum(region.area for region in regions)
    return small and attempt.fitted[regions[number].primitive].primitive.freeform


def _assembled_straight_or_bent(attempt: Attempt) -> AssemblyResult:
    """With edges as they are, or bent where that is what it takes to draw all faces."""
    result, checked = _assembled(attempt, bend=False)
    if checked.undrawn:
        bent, _ = _assembled(attempt, bend=True)
        if bent.gate.passed:
            return bent
    return result


def _assembled(attempt: Attempt, bend: bool) -> tuple[AssemblyResult, Checked]:
    """The first repair that passes the gate, or the one with the fewest faults."""
    topology, frame = attempt.topology, attempt.frame
    fitted = [widened(patch) for patch in attempt.fitted]
    draft = Draft(realise(topology, fitted, bend), fitted)
    fold(draft)
    layout = place(draft)
    left_out = {face.region for face in layout.faces if is_loose(face)} - attempt.facets.keys()
    layout, left_out = layout.without(left_out), left_out | draft.gone
    hollow = cavities(layout, [region.area for region in topology.regions], attempt.facets)
    bodies = build_bodies(faceted(layout, attempt.facets).in_world(frame))
    best: tuple[int, AssemblyResult, Joined, Checked] | None = None
    for variant in attempt.options.variants:
        repaired = [fix(body, frame.scale, variant) for body in bodies]
        faults = sum(fixed.faults for fixed in repaired)
        if best is not None and faults >= max(best[0], 1):
            continue
        shapes = [
            BodyShape(f.shape, f.regions, hollow[k], body.is_open)
            for f, k, body in zip(repaired, sorted(hollow), bodies)
        ]
        joined = join(shapes)
        result, checked = _judged(attempt, joined, variant)
        if result.gate.passed:
            return result, checked
        if best is None or faults < best[0]:
            best = faults, result, joined, checked
        if not faults and not checked.unkept:  # its surfaces are to blame, whatever the repair
            break
    if best is None:
        raise AssemblyError("no repair of the solid was asked for")
    limits = attempt.options.limits
    blamed = to_blame(best[2], best[3], topology, left_out, frame, limits)
    blamed = tuple(r for r in blamed if r not in attempt.facets)
    blamed = blamed or at_worst_edge(layout, topology, limits.tolerance)
    return replace(best[1], blamed=blamed), best[3]


def _judged(attempt: Attempt, joined: Joined, variant: Variant) -> tuple[AssemblyResult, Checked]:
    """The gate's verdict on one repair."""
    topology, frame = attempt.topology, attempt.frame
    primitive_of = [-1 if r in attempt.facets else region.primitive for r, region in enumerate(topology.regions)]
    numbers = [primitive_of[r] if r >= 0 else -1 for r in joined.regions]
    world: list[Primitive | None] = [
        attempt.fitted[k].primitive.scaled(frame.scale, frame.origin) if k >= 0 else None for k in numbers
    ]
    volume = topology.volume * frame.scale**3
    expected = Expected(
        joined.solids,
        volume,
        _judges(attempt.points, frame),
        frame.to_world(attempt.surface),
        frame.scale,
        joined.is_open,
    )
    limits = attempt.options.limits
    checked = check(joined.shape, world, expected, limits)
    reports = _reports(joined, numbers, world, checked)
    reports = tuple(replace(f, rung="freeform") if f.primitive in attempt.freeform else f for f in reports)
    return AssemblyResult(to_bytes(joined.shape), reports, checked.result, variant), checked


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
    if primitive.kind in SWEPT_KINDS:
        return "swept"
    return "bspline" if primitive.freeform else "exact"


def judge(attempt: Attempt) -> Verdict:
    """`assemble`, with the faces to blame where it fails."""
    try:
        result = assemble(attempt)
    except OpenFace as error:
        return Verdict(None, str(error), error.regions)
    return Verdict(result, result.gate.reason, result.blamed)
