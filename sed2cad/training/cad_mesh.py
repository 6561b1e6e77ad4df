"""What OCC says about a CAD file: its faces, their triangles, points and normals of their surfaces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MESH_DEVIATION = 4e-4
"""Of the triangles from the surfaces, in longest sides; bulged, those of B-splines are within 2e-4."""
MESH_ANGLE = 0.4
"""Largest turn of the normal over a triangle, radians."""


@dataclass(frozen=True)
class Mesh:
    nodes: NDArray  # (n, 3)
    uv: NDArray  # (n, 2) surface parameters on the node's face
    triangles: NDArray  # (m, 3)
    face: NDArray  # (m,) index of the face
    node_face: NDArray  # (n,)

    @property
    def frame(self) -> Frame:
        """The unit frame: the bounding box centred, its longest side 1."""
        low, high = self.nodes.min(0), self.nodes.max(0)
        return Frame((low + high) / 2, float((high - low).max()))


@dataclass(frozen=True)
class Frame:
    """Unit frame of a part: x -> (x - centre) / size."""

    centre: NDArray
    size: float

    def apply(self, points: NDArray) -> NDArray:
        return (points - self.centre) / self.size


def read_shape(path: Path) -> Any:
    """The shape in a .step, .stp or .brep file. Raises OSError."""
    from OCP.BRep import BRep_Builder
    from OCP.BRepTools import BRepTools
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopoDS import TopoDS_Shape

    if path.suffix.lower() == ".brep":
        shape = TopoDS_Shape()
        if not BRepTools.Read_s(shape, str(path), BRep_Builder()):
            raise OSError(f"cannot read {path}")
        return shape
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_RetDone or reader.TransferRoots() == 0:
        raise OSError(f"cannot read {path}")
    return reader.OneShape()


def faces_of(shape: Any) -> list[Any]:
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    found, explorer = [], TopExp_Explorer(shape, TopAbs_FACE)
    while explorer.More():
        found.append(TopoDS.Face_s(explorer.Current()))
        explorer.Next()
    if not found:
        raise ValueError("no faces")
    return found


def mesh_of(shape: Any, faces: list[Any]) -> Mesh:
    """Tessellate finely enough that triangle areas are surface areas; triangles turned outward."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.TopAbs import TopAbs_REVERSED

    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box)
    low, high = np.reshape(box.Get(), (2, 3))
    mesh = tessellated(shape, faces, MESH_DEVIATION * float((high - low).max()), MESH_ANGLE)
    mirrored = (face.Location().Transformation().IsNegative() for face in faces)
    inward = np.array([(face.Orientation() == TopAbs_REVERSED) != flip for face, flip in zip(faces, mirrored)])
    triangles = np.where(inward[mesh.face, None], mesh.triangles[:, ::-1], mesh.triangles)
    return replace(mesh, triangles=triangles)


def tessellated(shape: Any, faces: list[Any], deviation: float, angle: float) -> Mesh:
    """Triangles so near to the faces and turning so little, radians; turned as the surfaces are."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools
    from OCP.TopLoc import TopLoc_Location

    BRepTools.Clean_s(shape)  # a file may hold a mesh of its own
    BRepMesh_IncrementalMesh(shape, deviation, False, angle, False)
    nodes, uv, triangles, owner, node_owner, offset = [], [], [], [], [], 0
    for index, face in enumerate(faces):
        location = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face, location)
        if mesh is None or not mesh.NbTriangles():
            continue
        move, n = location.Transformation(), mesh.NbNodes()
        nodes += [array(mesh.Node(k).Transformed(move)) for k in range(1, n + 1)]
        uv += [mesh.UVNode(k).Coord() for k in range(1, n + 1)]
        triangles.append(np.array([mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)]) - 1 + offset)
        owner.append(np.full(len(triangles[-1]), index))
        node_owner.append(np.full(n, index))
        offset += n
    if not triangles:
        raise ValueError("no triangles")
    faces_of = np.concatenate(owner), np.concatenate(node_owner)
    return Mesh(np.array(nodes), np.array(uv), np.vstack(triangles), *faces_of)


def array(point: Any) -> NDArray:
    return np.array([point.X(), point.Y(), point.Z()])


def evaluate(face: Any, uv: NDArray) -> tuple[NDArray, NDArray]:
    """Points and unit normals (zero where degenerate) of a face's surface at parameters (n, 2)."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.gp import gp_Pnt, gp_Vec

    surface, p, du, dv = BRepAdaptor_Surface(face), gp_Pnt(), gp_Vec(), gp_Vec()
    values = np.empty((len(uv), 9))
    for row, (u, v) in zip(values, uv.tolist()):
        surface.D1(u, v, p, du, dv)
        row[:] = p.X(), p.Y(), p.Z(), du.X(), du.Y(), du.Z(), dv.X(), dv.Y(), dv.Z()
    normal = np.cross(values[:, 3:6], values[:, 6:9])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return values[:, :3], np.where(size > 1e-12, normal / np.maximum(size, 1e-12), 0)
