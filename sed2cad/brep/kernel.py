"""Small words for talking to OCC: points, directions, walks over shapes, measures."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from OCP.BinTools import BinTools
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.BRepTools import BRepTools
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_ShapeEnum, TopAbs_SHELL, TopAbs_SOLID, TopAbs_VERTEX
from OCP.TopExp import TopExp
from OCP.TopoDS import (
    TopoDS,
    TopoDS_Compound,
    TopoDS_Edge,
    TopoDS_Face,
    TopoDS_Shape,
    TopoDS_Shell,
    TopoDS_Solid,
    TopoDS_Vertex,
)
from OCP.TopTools import TopTools_IndexedMapOfShape

Array = NDArray[np.float64]


def pnt(point: Array) -> gp_Pnt:
    """A point (3,)."""
    return gp_Pnt(float(point[0]), float(point[1]), float(point[2]))


def direction(vector: Array) -> gp_Dir:
    """A direction (3,); its length does not matter."""
    return gp_Dir(float(vector[0]), float(vector[1]), float(vector[2]))


def axes(origin: Array, z: Array, x: Array) -> gp_Ax3:
    """A right-handed frame."""
    return gp_Ax3(pnt(origin), direction(z), direction(x))


def _subshapes(shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> list[TopoDS_Shape]:
    """The different subshapes of one kind, in the kernel's order."""
    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return [found.FindKey(k) for k in range(1, found.Extent() + 1)]


def faces(shape: TopoDS_Shape) -> list[TopoDS_Face]:
    """The faces of a shape, in order."""
    return [TopoDS.Face_s(f) for f in _subshapes(shape, TopAbs_FACE)]


def numbers(every: Sequence[TopoDS_Shape], wanted: Sequence[TopoDS_Shape]) -> list[int]:
    """Where each wanted shape stands among different ones; -1: nowhere. (== does not compare shapes.)"""
    found = TopTools_IndexedMapOfShape()
    for shape in every:
        found.Add(shape)
    return [found.FindIndex(shape) - 1 for shape in wanted]


def edges(shape: TopoDS_Shape) -> list[TopoDS_Edge]:
    """The edges of a shape, each once."""
    return [TopoDS.Edge_s(e) for e in _subshapes(shape, TopAbs_EDGE)]


def vertices(shape: TopoDS_Shape) -> list[TopoDS_Vertex]:
    """The vertices of a shape, each once."""
    return [TopoDS.Vertex_s(v) for v in _subshapes(shape, TopAbs_VERTEX)]


def solids(shape: TopoDS_Shape) -> list[TopoDS_Solid]:
    """The solids of a shape."""
    return [TopoDS.Solid_s(s) for s in _subshapes(shape, TopAbs_SOLID)]


def shells(shape: TopoDS_Shape) -> list[TopoDS_Shell]:
    """The shells of a shape."""
    return [TopoDS.Shell_s(s) for s in _subshapes(shape, TopAbs_SHELL)]


def is_valid(shape: TopoDS_Shape) -> bool:
    """Whether the kernel finds no fault."""
    return not shape.IsNull() and bool(BRepCheck_Analyzer(shape).IsValid())


def is_closed(shape: TopoDS_Shape) -> bool:
    """Whether there are shells and every edge of each has two sides."""
    found = shells(shape)
    return bool(found) and all(BRep_Tool.IsClosed_s(shell) for shell in found)


def volume(shape: TopoDS_Shape) -> float:
    """The volume; negative where the faces look inwards."""
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    return float(properties.Mass())


def area(shape: TopoDS_Shape, triangles: bool = False) -> float:
    """The area, or that of the triangles that a shape has; of a face without any the kernel takes the face's own."""
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties, False, triangles)
    return abs(float(properties.Mass()))


def measures(face: TopoDS_Face) -> Array:
    """Centre and root of the area (4,) of a face."""
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, properties)
    centre = properties.CentreOfMass()
    return np.array([centre.X(), centre.Y(), centre.Z(), np.sqrt(abs(properties.Mass()))])


def largest_tolerance(shape: TopoDS_Shape) -> float:
    """The largest tolerance of an edge or vertex."""
    values = [BRep_Tool.Tolerance_s(e) for e in edges(shape)] + [BRep_Tool.Tolerance_s(v) for v in vertices(shape)]
    return max(values, default=0.0)


def compound(shapes: Sequence[TopoDS_Shape]) -> TopoDS_Shape:
    """The shapes as one; a single shape stays itself."""
    if len(shapes) == 1:
        return shapes[0]
    builder, together = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(together)
    for shape in shapes:
        builder.Add(together, shape)
    return together


def to_bytes(shape: TopoDS_Shape) -> bytes:
    """The shape in the kernel's binary format, without triangles."""
    BRepTools.Clean_s(shape)
    stream = BytesIO()
    BinTools.Write_s(shape, stream)
    return stream.getvalue()


def from_bytes(brep: bytes) -> TopoDS_Shape:
    """The shape that `to_bytes` wrote."""
    shape = TopoDS_Shape()
    BinTools.Read_s(shape, BytesIO(brep))
    return shape
