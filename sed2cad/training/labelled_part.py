"""One CAD file to one labelled cloud: exact points and normals, patch, type, distance to the nearest edge."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.network.types import BSPLINE, CONE, CYLINDER, PLANE, SPHERE, TORUS

SAME_SURFACE = 2e-4
"""Two analytic surfaces are one when they differ by less than this (part scaled to longest side 1)."""
FAR_FROM_EDGES = 0.1
"""Distances to edges are capped here."""
EDGE_SPACING = 3e-3
"""Spacing of the points that stand for an edge."""


@dataclass(frozen=True)
class LabelledCloud:
    """A cloud in the unit frame (bounding box centred, longest side 1) with its truth, n points."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3) unit, outward, exact
    facet_normals: NDArray[np.float16]  # (n, 3) normals of the tessellation, as a mesh scan has them
    patch: NDArray[np.int16]  # (n,) patch id, 0 .. patches-1
    type: NDArray[np.int8]  # (n,) index into PATCH_TYPES
    edge_distance: NDArray[np.float16]  # (n,) to the nearest edge between two patches, at most FAR_FROM_EDGES

    def save(self, path: Path) -> None:
        with path.open("wb") as stream:
            np.savez(stream, **asdict(self))

    @classmethod
    def load(cls, path: Path) -> LabelledCloud:
        with np.load(path, allow_pickle=False) as arrays:
            return cls(**{name: arrays[name] for name in cls.__dataclass_fields__})


@dataclass(frozen=True)
class Surface:
    """The unbounded surface of a face, in the unit frame; of a cone: apex and half angle."""

    type: int
    axis: NDArray
    origin: NDArray
    radii: tuple[float, ...] = ()

    def same(self, other: Surface) -> bool:
        """Whether both are one surface; B-splines are never compared."""
        if self.type != other.type or self.type == BSPLINE:
            return False
        if self.type != SPHERE and abs(self.axis @ other.axis) < 1 - 1e-6:
            return False
        gap = other.origin - self.origin
        along = self.axis * (self.axis @ gap)
        gap = {PLANE: along, CYLINDER: gap - along}.get(self.type, gap)
        return bool(
            np.linalg.norm(gap) < SAME_SURFACE and np.allclose(self.radii, other.radii, 0, SAME_SURFACE)
        )


@dataclass(frozen=True)
class Frame:
    """Unit frame of a part: x -> (x - centre) / size."""

    centre: NDArray
    size: float

    def apply(self, points: NDArray) -> NDArray:
        return (points - self.centre) / self.size


def label_part(path: Path, count: int = 10_000, seed: int = 0) -> LabelledCloud:
    """Sample `count` labelled points uniformly by area. Raises OSError or ValueError for an unusable file."""
    shape = read_shape(path)
    faces = _faces(shape)
    mesh = _mesh(shape, faces)
    low, high = mesh.nodes.min(0), mesh.nodes.max(0)
    frame = Frame((low + high) / 2, float((high - low).max()))
    surfaces = [_surface(face, frame) for face in faces]
    patch_of_face, edges = _patches_and_edges(shape, faces, surfaces)
    points, normals, facet_normals, face = _sample(mesh, faces, count, np.random.default_rng(seed))
    points = frame.apply(points)
    _, patch = np.unique(patch_of_face[face], return_inverse=True)
    return LabelledCloud(
        points.astype(np.float32),
        normals.astype(np.float32),
        facet_normals.astype(np.float16),
        patch.astype(np.int16),
        np.array([surface.type for surface in surfaces], np.int8)[face],
        _edge_distance(points, edges, frame).astype(np.float16),
    )


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


def _faces(shape: Any) -> list[Any]:
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


@dataclass(frozen=True)
class _Mesh:
    nodes: NDArray  # (n, 3)
    uv: NDArray  # (n, 2) surface parameters on the node's face
    triangles: NDArray  # (m, 3)
    face: NDArray  # (m,) index of the face


def _mesh(shape: Any, faces: list[Any]) -> _Mesh:
    """Tessellate finely enough that triangle areas are surface areas."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRep import BRep_Tool
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopLoc import TopLoc_Location

    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box)
    BRepMesh_IncrementalMesh(shape, 2.5e-4 * box.SquareExtent() ** 0.5, False, 0.2, False)
    nodes, uv, triangles, owner, offset = [], [], [], [], 0
    for index, face in enumerate(faces):
        location = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face, location)
        if mesh is None:
            continue
        move, n = location.Transformation(), mesh.NbNodes()
        nodes += [_array(mesh.Node(k).Transformed(move)) for k in range(1, n + 1)]
        uv += [mesh.UVNode(k).Coord() for k in range(1, n + 1)]
        corners = [mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)]
        triangles.append(np.array(corners).reshape(-1, 3) - 1 + offset)
        owner.append(np.full(len(corners), index))
        offset += n
    if not triangles:
        raise ValueError("no triangles")
    return _Mesh(np.array(nodes), np.array(uv), np.vstack(triangles), np.concatenate(owner))


def _array(point: Any) -> NDArray:
    return np.array([point.X(), point.Y(), point.Z()])


def _surface(face: Any, frame: Frame) -> Surface:
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_SurfaceType as Kind

    surface = BRepAdaptor_Surface(face)
    radii: tuple[float, ...]
    match surface.GetType():
        case Kind.GeomAbs_Plane:
            found, type_, radii = surface.Plane(), PLANE, ()
        case Kind.GeomAbs_Cylinder:
            found, type_ = surface.Cylinder(), CYLINDER
            radii = (found.Radius() / frame.size,)
        case Kind.GeomAbs_Cone:
            found, type_ = surface.Cone(), CONE
            radii = (abs(found.SemiAngle()),)
        case Kind.GeomAbs_Sphere:
            found, type_ = surface.Sphere(), SPHERE
            radii = (found.Radius() / frame.size,)
        case Kind.GeomAbs_Torus:
            found, type_ = surface.Torus(), TORUS
            radii = (found.MajorRadius() / frame.size, found.MinorRadius() / frame.size)
        case _:
            return Surface(BSPLINE, np.zeros(3), np.zeros(3))
    position = found.Position()
    origin = found.Apex() if type_ == CONE else position.Location()
    return Surface(type_, _array(position.Direction()), frame.apply(_array(origin)), radii)


def _patches_and_edges(shape: Any, faces: list[Any], surfaces: list[Surface]) -> tuple[NDArray, list[Any]]:
    """Patch of each face (touching faces on one surface are one patch), and the edges between two patches."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE
    from OCP.TopExp import TopExp
    from OCP.TopoDS import TopoDS
    from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape, TopTools_IndexedMapOfShape
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    numbers = TopTools_IndexedMapOfShape()
    index = {numbers.Add(face): i for i, face in enumerate(faces)}
    owners = TopTools_IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndAncestors_s(shape, TopAbs_EDGE, TopAbs_FACE, owners)
    shared = []
    for k in range(1, owners.Extent() + 1):
        edge = TopoDS.Edge_s(owners.FindKey(k))
        touching = sorted({index[numbers.FindIndex(face)] for face in owners.FindFromIndex(k)})
        if len(touching) > 1 and not BRep_Tool.Degenerated_s(edge):
            shared.append((edge, touching))
    joined = [(t[0], other) for _, t in shared for other in t[1:] if surfaces[t[0]].same(surfaces[other])]
    i, j = np.array(joined, int).reshape(-1, 2).T
    _, patch = connected_components(coo_matrix((np.ones(len(i)), (i, j)), (len(faces),) * 2), directed=False)
    return patch, [edge for edge, touching in shared if len(set(patch[touching])) > 1]


def _edge_distance(points: NDArray, edges: list[Any], frame: Frame) -> NDArray:
    """Distance of each point to the nearest edge, capped at FAR_FROM_EDGES."""
    if not edges:
        return np.full(len(points), FAR_FROM_EDGES)
    on_edges = frame.apply(np.vstack([_points_on(edge, EDGE_SPACING * frame.size) for edge in edges]))
    distance, _ = cKDTree(on_edges).query(points, distance_upper_bound=FAR_FROM_EDGES)
    return np.minimum(distance, FAR_FROM_EDGES)


def _points_on(edge: Any, spacing: float) -> NDArray:
    from OCP.BRepAdaptor import BRepAdaptor_Curve

    curve = BRepAdaptor_Curve(edge)

    def at(n: int) -> NDArray:
        return np.array(
            [_array(curve.Value(t)) for t in np.linspace(curve.FirstParameter(), curve.LastParameter(), n)]
        )

    length = np.linalg.norm(np.diff(at(12), axis=0), axis=1).sum()
    return at(int(np.clip(length / spacing, 12, 1500)))


def _sample(mesh: _Mesh, faces: list[Any], count: int, rng: np.random.Generator) -> tuple[NDArray, ...]:
    """Points on the exact surfaces, uniform by area, exact and facet normals (outward), face index."""
    a, b, c = (mesh.nodes[mesh.triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    pick = rng.choice(len(area), count, p=area / area.sum())
    weight = rng.random((count, 2))
    weight = np.where(weight.sum(1, keepdims=True) > 1, 1 - weight, weight)
    weight = np.c_[1 - weight.sum(1), weight]
    uv = np.einsum("ij,ijk->ik", weight, mesh.uv[mesh.triangles[pick]])
    owner = mesh.face[pick]
    facet = (np.cross(b - a, c - a) / np.maximum(area, 1e-300)[:, None])[pick] * _side(faces)[owner]
    points, normals = np.empty((count, 3)), np.empty((count, 3))
    for face in np.unique(owner):
        rows = np.flatnonzero(owner == face)
        points[rows], normals[rows] = _evaluate(faces[face], uv[rows])
    normals *= _side(faces)[owner]
    degenerate = np.linalg.norm(normals, axis=1) < 0.5  # at a pole
    normals[degenerate] = facet[degenerate]
    return points, normals, facet, owner


def _evaluate(face: Any, uv: NDArray) -> tuple[NDArray, NDArray]:
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


def _side(faces: list[Any]) -> NDArray:
    """-1 for faces that are used from behind, else 1, as a column."""
    from OCP.TopAbs import TopAbs_REVERSED

    return np.array([-1.0 if face.Orientation() == TopAbs_REVERSED else 1.0 for face in faces])[:, None]
