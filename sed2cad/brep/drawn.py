"""Faces that the kernel takes for valid but cannot draw: seen closely, the edges around them cross."""

from __future__ import annotations

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape

from sed2cad.brep.kernel import area, faces

_DEFLECTION = 1e-4  # of the diagonal: as fine as a CAD program draws, where crossings of 1e-4 count
_ANGLE = 0.2  # radians between neighbouring triangles
_OFF = 0.3  # relative difference between the areas of a face and of its triangles
_SPECK = 1e-4  # of the squared diagonal: smaller differences are hardly seen


def undrawn(shape: TopoDS_Shape, diagonal: float) -> tuple[int, ...]:
    """Numbers of the faces of a valid shape whose triangles are missing or of another area than the face.

    A STEP file of them opens with holes, or with lids on holes. (An invalid shape can keep the kernel busy for
    ever.)
    """
    BRepTools.Clean_s(shape)
    BRepMesh_IncrementalMesh(shape, _DEFLECTION * diagonal, False, _ANGLE, False)
    own = faces(shape)
    real = np.array([area(face) for face in own])
    drawn = np.array([area(face, triangles=True) if _has_triangles(face) else 0.0 for face in own])
    BRepTools.Clean_s(shape)
    off = np.abs(drawn - real) > _OFF * real + _SPECK * diagonal**2
    return tuple(int(number) for number in np.flatnonzero(off))


def _has_triangles(face: TopoDS_Face) -> bool:
    return BRep_Tool.Triangulation_s(face, TopLoc_Location()) is not None
