"""STEP files: the same bytes for the same shape, faces with names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.IFSelect import IFSelect_RetDone
from OCP.Interface import Interface_Static
from OCP.Message import Message, Message_Fail
from OCP.StepBasic import StepBasic_Product
from OCP.STEPConstruct import STEPConstruct
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Controller, STEPControl_Reader, STEPControl_Writer
from OCP.StepData import StepData_StepModel
from OCP.StepShape import StepShape_AdvancedFace
from OCP.TCollection import TCollection_HAsciiString
from OCP.TopoDS import TopoDS_Shape

from sed2cad.brep.kernel import faces
from sed2cad.errors import AssemblyError

_UNITS = {"mm": "MM", "cm": "CM", "m": "M", "in": "INCH"}
_SCHEMA = 4  # AP214 IS: what every CAD system reads
_TIME = "2000-01-01T00:00:00"  # a fixed time stamp, so that the same solid is the same file


def write_step(
    shape: TopoDS_Shape, path: Path, names: Sequence[str] = (), product: str = "part", unit: str = "mm"
) -> None:
    """Write `shape`, whose coordinates are in `unit`; `names` are those of its faces, in order.

    AssemblyError where the kernel cannot write it.
    """
    _prepare()
    _settings(unit)
    writer = STEPControl_Writer()
    if writer.Transfer(shape, STEPControl_AsIs) != IFSelect_RetDone:
        raise AssemblyError("the CAD kernel could not translate the solid to STEP")
    finder = writer.WS().TransferWriter().FinderProcess()
    for face, name in zip(faces(shape), names):
        item = STEPConstruct.FindEntity_s(finder, face)
        if item is not None:
            item.SetName(_text(name))
    _label(writer.Model(), product)
    if writer.Write(str(path)) != IFSelect_RetDone:
        raise AssemblyError(f"the CAD kernel could not write {path}")


def read_step(path: Path, unit: str = "mm") -> TopoDS_Shape:
    """The shape of a STEP file, in `unit`. AssemblyError where there is none."""
    return _read(path, unit).OneShape()


def read_face_names(path: Path) -> tuple[str, ...]:
    """The names of the faces of a STEP file, in the order of the faces that `read_step` gives."""
    reader = _read(path, "mm")
    transfer = reader.WS().TransferReader()
    items = [transfer.EntityFromShapeResult(face, 1) for face in faces(reader.OneShape())]
    return tuple(item.Name().ToCString() if isinstance(item, StepShape_AdvancedFace) else "" for item in items)


def _read(path: Path, unit: str) -> STEPControl_Reader:
    """A reader that has read and translated the file."""
    _prepare()
    Interface_Static.SetCVal_s("xstep.cascade.unit", _UNITS[unit])
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_RetDone or reader.TransferRoots() == 0:
        raise AssemblyError(f"the CAD kernel cannot read {path}")
    return reader


def _settings(unit: str) -> None:
    """Set all of the writer's global switches that matter, whatever they were before."""
    Interface_Static.SetCVal_s("xstep.cascade.unit", _UNITS[unit])
    Interface_Static.SetCVal_s("write.step.unit", _UNITS[unit])
    Interface_Static.SetIVal_s("write.step.schema", _SCHEMA)
    Interface_Static.SetIVal_s("write.step.assembly", 0)
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 1)
    Interface_Static.SetIVal_s("write.precision.mode", 0)


def _label(model: StepData_StepModel, product: str) -> None:
    """Name the product (the kernel counts its own names up) and fill the header."""
    for entity in (model.Value(k) for k in range(1, model.NbEntities() + 1)):
        if isinstance(entity, StepBasic_Product):
            entity.SetId(_text(product))
            entity.SetName(_text(product))
            break
    header = APIHeaderSection_MakeHeader(model)
    header.SetTimeStamp(_text(_TIME))
    header.SetName(_text(product))
    header.SetOriginatingSystem(_text("sed2cad"))
    header.SetAuthorValue(1, _text(""))
    header.SetOrganizationValue(1, _text(""))


def _prepare() -> None:
    """Make the kernel's switches exist; keep its statistics off the terminal."""
    STEPControl_Controller.Init_s()
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Fail)


def _text(text: str) -> TCollection_HAsciiString:
    """A kernel string; STEP is ASCII."""
    return TCollection_HAsciiString(text.encode("ascii", "replace").decode("ascii"))
