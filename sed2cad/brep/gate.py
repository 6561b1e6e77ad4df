"""The gate: what a solid must show, without knowing the true part, before anybody claims it is one."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.TopoDS import TopoDS_Shape
from scipy.spatial import cKDTree

from sed2cad.brep.attempt import GateResult, Limits
from sed2cad.brep.drawn import undrawn
from sed2cad.brep.kernel import Array, faces, is_closed, is_valid, largest_tolerance, measures, solids, volume
from sed2cad.brep.measure import Deviations, deviations
from sed2cad.brep.step import read_step, write_step
from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import Primitive

_DEFLECTION = 2e-3  # of the diagonal: tessellation for distances
_ROUND_TRIP = 1e-3  # relative change of the volume by writing and reading


@dataclass(frozen=True)
class Expected:
    """What the scan says about the solid, in world coordinates."""

    bodies: int
    volume: float  # of the proxy mesh; NaN: unknown, not checked
    points: Array  # (n, 3); none: not checked
    surface: Array  # (m, 3) of the scan and its proxy, near which all of the solid lies; none: not checked
    diagonal: float
    is_open: bool = False  # whether there are shells that need not be closed: then nothing is known of the volume


@dataclass(frozen=True)
class Checked:
    """The gate's verdict and what is behind it."""

    result: GateResult
    deviations: Deviations | None  # None where the solid was not fit to be measured
    undrawn: tuple[int, ...] = ()  # numbers of faces that cannot be drawn; looked for when all else is well
    unkept: bool = False  # whether all is well but that a STEP file does not keep it
    changed: tuple[int, ...] = ()  # numbers of the faces that it does not keep


@dataclass(frozen=True)
class ReadBack:
    """What becomes of a shape in a STEP file."""

    shape: TopoDS_Shape | None  # face for face; None where it is no longer the same and valid
    changed: tuple[int, ...] = ()  # numbers of the faces that are to blame for that


def check(
    shape: TopoDS_Shape, primitives: Sequence[Primitive | None], expected: Expected, limits: Limits
) -> Checked:
    """Look at `shape`, whose faces lie on `primitives` (None: unknown), world coordinates.

    Nothing that could hang on a broken shape is done to one.
    """
    count, closed, valid = len(solids(shape)), is_closed(shape), is_valid(shape)
    sound = (closed or expected.is_open) and valid and count == expected.bodies
    size = volume(shape) if sound and closed else math.nan
    ratio = size / expected.volume if sound and expected.volume else math.nan
    tolerance = largest_tolerance(shape)
    measured = None
    if sound and len(expected.points):
        measured = deviations(shape, primitives, expected.points, _DEFLECTION * expected.diagonal)
    stray = near = math.nan
    spread = (math.nan,) * 3
    if measured is not None:
        near = float((measured.distances <= limits.distance * expected.diagonal).mean())
        spread = (measured.rms, measured.p95, measured.max)
        stray = measured.stray(expected.surface) if len(expected.surface) else math.nan
    found = GateResult(False, "", count, closed, valid, size, ratio, near, *spread, stray, tolerance, False)
    reason = _first_fault(found, expected, limits)
    back = ReadBack(None) if reason else through_step(shape)
    hidden = () if back.shape is None else undrawn(back.shape, expected.diagonal)
    unkept = not reason and back.shape is None
    if unkept:
        reason = "it is no longer valid after writing and reading the STEP file"
    elif hidden:
        reason = f"{len(hidden)} of its faces cannot be drawn, their edges cross"
    found = replace(found, passed=not reason, reason=reason, step_valid=back.shape is not None, undrawn=len(hidden))
    return Checked(found, measured, hidden, unkept, back.changed)


def _first_fault(found: GateResult, expected: Expected, limits: Limits) -> str:
    """The first thing that is wrong; NaN stands for what cannot be checked."""
    if found.solids != expected.bodies:
        return f"{found.solids} solids instead of {expected.bodies}"
    if not found.closed and not expected.is_open:
        return "the shell is not closed"
    if not found.valid:
        return "the CAD kernel finds it invalid"
    if abs(found.volume_ratio - 1) > limits.volume:
        return f"its volume is {100 * (found.volume_ratio - 1):+.1f} % off the scan's"
    if found.coverage < limits.coverage:
        return f"only {100 * found.coverage:.1f} % of the points lie on it"
    stray, tolerance = found.stray / expected.diagonal, found.max_tolerance / expected.diagonal
    if stray > limits.stray:
        return f"a face reaches {100 * stray:.0f} % of the part's size beyond the scan"
    if tolerance > limits.tolerance:
        return f"an edge is {100 * tolerance:.1f} % of the part's size away from its faces"
    return ""


def through_step(shape: TopoDS_Shape) -> ReadBack:
    """The shape as its STEP file reads back."""
    with tempfile.TemporaryDirectory(prefix="sed2cad-") as folder:
        path = Path(folder) / "check.step"
        try:
            write_step(shape, path)
            back = read_step(path)
        except AssemblyError:
            return ReadBack(None)
    closed = is_closed(shape)
    same = len(solids(back)) == len(solids(shape)) and len(faces(back)) == len(faces(shape))
    alike = not closed or math.isclose(volume(back), volume(shape), rel_tol=_ROUND_TRIP)
    if same and alike and is_closed(back) == closed and is_valid(back):
        return ReadBack(back)
    return ReadBack(None, _changed(shape, back))


def _changed(shape: TopoDS_Shape, back: TopoDS_Shape) -> tuple[int, ...]:
    """Numbers of the faces that are not among the valid ones that were read, by their areas and centres."""
    check = BRepCheck_Analyzer(back)
    kept = np.array([measures(face) for face in faces(back) if check.IsValid(face)]).reshape(-1, 4)
    wanted = np.array([measures(face) for face in faces(shape)]).reshape(-1, 4)
    if len(kept) == 0:
        return tuple(range(len(wanted)))
    off, _ = cKDTree(kept).query(wanted)
    return tuple(np.flatnonzero(off > _ROUND_TRIP * wanted[:, 3]).tolist())
