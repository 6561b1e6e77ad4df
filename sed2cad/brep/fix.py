"""Bring a raw solid into the kernel's order: curves on surfaces, seams, tolerances; and check it.

ShapeFix's many repairs help mostly and harm sometimes, so a few selections of them are tried until the gate
is content. The history tells which face of the result came from which region.
"""

from __future__ import annotations

from dataclasses import dataclass

from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepLib import BRepLib
from OCP.ShapeFix import ShapeFix_Shape
from OCP.TopoDS import TopoDS, TopoDS_Shape, TopoDS_Solid

from sed2cad.brep.attempt import Variant
from sed2cad.brep.kernel import faces, is_closed, numbers, solids, volume
from sed2cad.brep.solid import PRECISION, Body

_HOPELESS = 1000  # faults of a body that the repair gave up on
_LARGEST = 0.02  # of the diagonal: no repair may raise a tolerance above this
_LOOSE = 1e-4  # of the diagonal: precision of the loose variant

_FACE_OFF = (
    "FixAddNaturalBoundMode",
    "FixSmallAreaWireMode",
    "RemoveSmallAreaFaceMode",
    "FixIntersectingWiresMode",
    "FixLoopWiresMode",
    "FixSplitFaceMode",
)
_WIRE_OFF = (
    "FixReorderMode",
    "FixSmallMode",
    "FixConnectedMode",
    "FixSelfIntersectionMode",
    "FixLackingMode",
    "FixNotchedEdgesMode",
    "FixTailMode",
    "FixGaps3dMode",
    "FixGaps2dMode",
)


@dataclass(frozen=True)
class Fixed:
    """A repaired body."""

    shape: TopoDS_Shape  # a solid or an open shell, unless the repair broke it apart
    regions: tuple[int, ...]  # of each of its faces, in order; -1 where the history does not tell
    faults: int  # 0: one closed valid solid, or valid open shell, with all of its faces


def fix(body: Body, diagonal: float, variant: Variant) -> Fixed:
    """One selection of repairs on a copy of the body."""
    try:
        return _fixed(body, diagonal, variant)
    except Exception:  # what the kernel raises has no common base: Standard_Failure, Standard_ConstructionError, ...
        return Fixed(body.shape, body.regions, _HOPELESS)


def _fixed(body: Body, diagonal: float, variant: Variant) -> Fixed:
    copy = BRepBuilderAPI_Copy(body.shape)
    tool = ShapeFix_Shape(copy.Shape())
    tool.SetPrecision(_LOOSE * diagonal if variant == "loose" else PRECISION)
    tool.SetMinTolerance(PRECISION)
    tool.SetMaxTolerance(_LARGEST * diagonal)
    if variant in ("min", "min+"):
        _restrain(tool, orient=variant == "min+")
    tool.Perform()
    shape = tool.Shape()
    BRepLib.SameParameter_s(shape, PRECISION, False)
    BRepLib.UpdateTolerances_s(shape, False)
    found = solids(shape)
    if len(found) == 1:
        shape = found[0]
        if volume(shape) < 0:
            BRepLib.OrientClosedSolid_s(TopoDS.Solid_s(shape))
    regions = _regions(body, copy, tool, shape)
    lost = len(set(body.regions) - set(regions))
    return Fixed(shape, regions, _faults(shape, body.is_open) + lost)


def _regions(body: Body, copy: BRepBuilderAPI_Copy, tool: ShapeFix_Shape, shape: TopoDS_Shape) -> tuple[int, ...]:
    """The region of each face of the result, from the histories of the copy and the repair."""
    every = faces(shape)
    regions = [-1] * len(every)
    descendants = [faces(tool.Context().Apply(copy.ModifiedShape(face))) for face in body.faces]
    heirs = [(heir, region) for own, region in zip(descendants, body.regions) for heir in own]
    for number, (_, region) in zip(numbers(every, [heir for heir, _ in heirs]), heirs):
        if number >= 0:
            regions[number] = region
    return tuple(regions)


def _restrain(tool: ShapeFix_Shape, orient: bool) -> None:
    """Only what cannot be done without: curves on surfaces, seams, degenerated edges."""
    face_tool, wire_tool = tool.FixFaceTool(), tool.FixWireTool()
    for mode in _FACE_OFF:
        setattr(face_tool, mode, 0)
    for mode in _WIRE_OFF:
        setattr(wire_tool, mode, 0)
    face_tool.FixOrientationMode = int(orient)
    face_tool.FixMissingSeamMode = 1
    face_tool.FixPeriodicDegeneratedMode = 1
    wire_tool.FixEdgeCurvesMode = 1
    wire_tool.FixDegeneratedMode = 1
    wire_tool.FixShiftedMode = 1
    tool.FixSolidTool().FixShellTool().FixOrientationMode = int(orient)


def _faults(shape: TopoDS_Shape, is_open: bool) -> int:
    """0 for one closed valid solid, or a valid shell if it is open; otherwise grows with what is wrong."""
    faults = 0
    if not is_open:
        faults += 0 if isinstance(shape, TopoDS_Solid) or len(solids(shape)) == 1 else 10
        faults += 0 if is_closed(shape) else 10
    check = BRepCheck_Analyzer(shape)
    if not check.IsValid():
        faults += max(1, sum(not check.IsValid(face) for face in faces(shape)))
    return faults
