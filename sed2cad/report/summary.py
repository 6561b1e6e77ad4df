"""From an assembly to its report."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sed2cad.assembly import FACETS, Assembly
from sed2cad.brep.attempt import Limits
from sed2cad.completion.complete import Completed
from sed2cad.constraints import Constraint
from sed2cad.geometry.chains import length
from sed2cad.primitives.names import primitive_names
from sed2cad.report.report import Boundary, ConstraintSummary, Deviation, FaceSummary, Report
from sed2cad.rungs import UNREGULARISED
from sed2cad.scan.scan import Frame

ANGULAR = ("parallel", "perpendicular", "angle", "half_angle")  # kinds and measures


def summarise(
    assembly: Assembly, completed: Completed, seconds: tuple[tuple[str, float], ...], notes: tuple[str, ...]
) -> Report:
    """What the user is told, in the scan's unit. A fallback is a warning, never silent."""
    gate, frame = assembly.solid.gate, completed.scan.frame
    faces = tuple(
        FaceSummary(name, face.rung, face.deviation) for name, face in zip(assembly.face_names, assembly.solid.faces)
    )
    names = primitive_names(assembly.fitted)
    warnings = list(notes)
    if assembly.rung == FACETS:
        warnings.append(
            "the solid is made of facets: no exact one passed the checks (a larger --tolerance allows simpler faces)"
        )
    else:
        warnings += _replaced(assembly)
    if assembly.rung == UNREGULARISED and assembly.failures:
        warnings.append("nothing was made parallel, equal, ... or rounded: with that, no solid passed the checks")
    warnings += _unseen(assembly, completed)
    if not gate.passed:
        warnings.append(f"the solid did not pass all checks: {gate.reason}")
    freeform = sum(face.rung == "bspline" for face in faces)
    if freeform:
        warnings.append(f"{freeform} of {len(faces)} faces are freeform (B-spline)")
    return Report(
        closed=gate.closed and gate.valid,
        rung=assembly.rung,
        reason="; ".join(assembly.failures),
        faces=len(faces),
        exact_faces=sum(face.rung == "exact" for face in faces),
        volume=gate.volume,
        deviation=Deviation(gate.rms, gate.p95, gate.max),
        face_list=faces,
        constraints=tuple(_told(c, names, frame.scale) for c in assembly.constraints),
        seconds=seconds,
        warnings=tuple(warnings),
        boundaries=_boundaries(assembly, names, frame),
    )


def _unseen(assembly: Assembly, completed: Completed) -> list[str]:
    """What the solid shows and the scan does not."""
    if completed.seen is None:
        return []
    how = str(completed)
    if assembly.open_at:
        extended = any(k in completed.caps for k in assembly.open_at)
        how = ("faces were extended, and " if extended else "") + "the shell is open where it ends"
    elif completed.caps and assembly.rung == FACETS:
        how = "facets close it"
    said = [f"the scan does not show all of the part: {how}"]
    coverage = assembly.solid.gate.coverage
    if assembly.open_at and coverage < Limits().coverage:
        said.append(f"only {100 * coverage:.1f} % of the points lie on faces: others could not be built")
    return said


def _boundaries(assembly: Assembly, names: tuple[str, ...], frame: Frame) -> tuple[Boundary, ...]:
    """The loops that the faces which were left out had, the longest first."""
    regions, chains = assembly.topology.regions, assembly.topology.chains
    found = []
    for region in (region for region in regions if region.primitive in assembly.open_at):
        surface = assembly.fitted[region.primitive].primitive
        for loop in region.loops:
            beside = [regions[chains[k].right if way > 0 else chains[k].left].primitive for k, way in loop]
            ways = []
            for other, chain in zip(beside, (chains[k] for k, _ in loop)):
                on = surface if surface.freedom else assembly.fitted[other].primitive
                ways.append((frame.to_world(on.project(chain.points)), chain.closed))
            low, high = (end([end(way, axis=0) for way, _ in ways], axis=0) for end in (np.min, np.max))
            x, y, z = ((low + high) / 2).tolist()
            along = dict.fromkeys(names[other] for other in beside)
            found.append(Boundary(tuple(along), sum(length(*way) for way in ways), (x, y, z)))
    return tuple(sorted(found, key=lambda boundary: -boundary.length))


def _replaced(assembly: Assembly) -> list[str]:
    """What stands in for faces that could not be exact."""
    smooth = {face.region for face in assembly.solid.faces if face.rung == "freeform"}
    cut = {face.region for face in assembly.solid.faces if face.rung == "facets"}
    whole = len({face.region for face in assembly.solid.faces})
    said = []
    if smooth:
        said.append(f"{len(smooth)} of {whole} faces could not be exact and are freeform instead")
    if cut:
        said.append(f"{len(cut)} of {whole} faces could not be exact and are made of facets")
    return said


def _told(constraint: Constraint, names: tuple[str, ...], scale: float) -> ConstraintSummary:
    """A constraint in the scan's unit and degrees."""
    angular = constraint.kind in ANGULAR or constraint.measure in ANGULAR
    unit = 180 / math.pi if angular else scale
    faces = tuple(names[index] for index in constraint.patches)
    told = ConstraintSummary(
        constraint.kind, faces, constraint.residual * unit, angular, constraint.measure, detail=constraint.detail
    )
    if not constraint.measure:
        return told
    return replace(told, before=constraint.before * unit, after=constraint.after * unit)
