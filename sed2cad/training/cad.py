"""One CAD file to one LabelledPart: surfaces as the file or their shape says, patches, edges."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.types import BSPLINE, CONE, CYLINDER, PLANE, SPHERE, TORUS
from sed2cad.training.cad_mesh import Frame, Mesh, array, evaluate, faces_of, mesh_of, read_shape
from sed2cad.training.disguised import recognise
from sed2cad.training.labelled_part import EDGE_UNIT, NORMAL_UNIT, LabelledPart, facets
from sed2cad.training.surfaces import Surfaces

EDGE_DEVIATION = 5e-5
"""Of the polylines from the edge curves, in longest sides."""
ON_SURFACE = 2e-5
"""Points of an analytic face are this near to its closed form; else (a spindle torus) it is a B-spline."""
PROBES = 150
"""Points per face on which a disguised surface is recognised."""


def label_part(path: Path) -> LabelledPart:
    """Everything that training needs of a CAD file. Raises OSError or ValueError for an unusable file."""
    return part_and_frame(path)[0]


def part_and_frame(path: Path) -> tuple[LabelledPart, Frame]:
    """The same, and where the unit frame lies in the file's."""
    shape = read_shape(path)
    faces = faces_of(shape)
    mesh = mesh_of(shape, faces)
    frame = mesh.frame
    nodes = frame.apply(mesh.nodes)
    surfaces, normals, disguised = _surfaces(faces, mesh, nodes, frame)
    patch_of_face, edges = _patches_and_edges(shape, faces, surfaces)
    side, normals = _outward(surfaces, mesh, nodes, normals)
    used = np.unique(mesh.face)  # faces without triangles have no patch
    patch = np.full(len(faces), -1, np.int16)
    patch[used] = np.unique(patch_of_face[used], return_inverse=True)[1]
    lines = [frame.apply(_points_on(edge, frame.size)) for edge in edges]
    starts = np.cumsum([0, *(len(line) for line in lines)])
    small = np.uint16 if len(nodes) < 65_536 else np.uint32
    part = LabelledPart(
        nodes.astype(np.float32),
        np.rint(normals / NORMAL_UNIT).astype(np.int16),
        mesh.triangles.astype(small),
        mesh.face.astype(np.uint16),
        patch,
        surfaces.type,
        np.array([_is_closed(face) for face in faces]),
        disguised,
        side,
        surfaces.origin,
        surfaces.axis,
        surfaces.radii,
        np.rint(np.vstack([np.empty((0, 3)), *lines]) / EDGE_UNIT).astype(np.int16),
        starts[:-1].astype(np.uint16 if starts[-1] < 65_536 else np.uint32),
    )
    return part, frame


def _surfaces(
    faces: list[Any], mesh: Mesh, nodes: NDArray, frame: Frame
) -> tuple[Surfaces, NDArray, NDArray[np.bool_]]:
    """Surface of each face, normals (n, 3) of the nodes on B-splines (0 elsewhere), and who was disguised."""
    rows = [_surface(face, frame) for face in faces]
    disguised, normals = np.zeros(len(faces), bool), np.zeros_like(nodes)
    order = np.argsort(mesh.node_face, kind="stable")
    bounds = np.searchsorted(mesh.node_face[order], np.arange(len(faces) + 1))
    for index, face in enumerate(faces):
        own = order[bounds[index] : bounds[index + 1]]
        if not len(own):
            continue
        if _is_on(rows[index], nodes[own]):
            continue
        points, exact = evaluate(face, mesh.uv[own])  # nodes on an edge may be off by its tolerance
        if _is_on(rows[index], frame.apply(points)):
            continue
        found = recognise(*_probes(face, mesh, own, index, frame))
        disguised[index] = found is not None
        rows[index] = found or _FREEFORM
        if found is None:
            normals[own] = exact
    columns = (np.concatenate(values) for values in zip(*((r.type, r.origin, r.axis, r.radii) for r in rows)))
    return Surfaces(*columns), normals, disguised


def _is_on(surface: Surfaces, points: NDArray) -> bool:
    """Whether points (n, 3) lie on an analytic surface, one row."""
    if surface.type[0] == BSPLINE:
        return False
    feet, _ = surface[np.zeros(len(points), int)].project(points)
    return bool(np.abs(feet - points).max() < ON_SURFACE)


def _probes(face: Any, mesh: Mesh, own: NDArray, index: int, frame: Frame) -> tuple[NDArray, NDArray]:
    """Exact points and normals all over a face: nodes and points within triangles."""
    rng = np.random.default_rng(0)
    inside = mesh.triangles[rng.choice(np.flatnonzero(mesh.face == index), PROBES)]
    weight = rng.dirichlet(np.ones(3), PROBES)
    uv = np.einsum("ij,ijk->ik", weight, mesh.uv[inside])
    points, normals = evaluate(face, np.vstack([uv, mesh.uv[rng.permutation(own)[:PROBES]]]))
    good = np.einsum("ij,ij->i", normals, normals) > 0.25
    return frame.apply(points[good]), normals[good]


_FREEFORM = Surfaces(np.array([BSPLINE], np.int8), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 2)))


def _surface(face: Any, frame: Frame) -> Surfaces:
    """The surface as the file has it, one row."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_SurfaceType as Kind

    surface, size = BRepAdaptor_Surface(face), frame.size
    radii = [0.0, 0.0]
    match surface.GetType():
        case Kind.GeomAbs_Plane:
            found, type_ = surface.Plane(), PLANE
        case Kind.GeomAbs_Cylinder:
            found, type_ = surface.Cylinder(), CYLINDER
            radii[0] = found.Radius() / size
        case Kind.GeomAbs_Cone:
            found, type_ = surface.Cone(), CONE
            radii[0] = abs(found.SemiAngle())
        case Kind.GeomAbs_Sphere:
            found, type_ = surface.Sphere(), SPHERE
            radii[0] = found.Radius() / size
        case Kind.GeomAbs_Torus:
            found, type_ = surface.Torus(), TORUS
            radii = [found.MajorRadius() / size, found.MinorRadius() / size]
        case _:
            return _FREEFORM
    position = found.Position()
    axis, origin = array(position.Direction()), position.Location()
    if type_ == CONE:
        origin = found.Apex()
        middle = surface.Value(
            (surface.FirstUParameter() + surface.LastUParameter()) / 2,
            (surface.FirstVParameter() + surface.LastVParameter()) / 2,
        )
        axis = axis if (array(middle) - array(origin)) @ axis > 0 else -axis
    row = frame.apply(array(origin))[None], axis[None], np.array([radii])
    return Surfaces(np.array([type_], np.int8), *row)


def _is_closed(face: Any) -> bool:
    """Whether the unbounded surface of a face is closed or periodic in a direction."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    surface = BRepAdaptor_Surface(face, False)
    return bool(surface.IsUClosed() or surface.IsVClosed() or surface.IsUPeriodic() or surface.IsVPeriodic())


def _outward(surfaces: Surfaces, mesh: Mesh, nodes: NDArray, normals: NDArray) -> tuple[NDArray, NDArray]:
    """Side of each face (f,), and the node normals turned outward, by the triangles."""
    facet, area = facets(nodes, mesh.triangles)
    middle = nodes[mesh.triangles].mean(1)
    own = surfaces[mesh.face].project(middle)[1] + normals[mesh.triangles].sum(1)
    agree = np.einsum("ij,ij->i", own, facet) * area
    votes = np.bincount(mesh.face, agree, len(surfaces.type))
    side = np.where(votes < 0, -1, 1).astype(np.int8)
    return side, normals * side[mesh.node_face][:, None]


def _patches_and_edges(shape: Any, faces: list[Any], surfaces: Surfaces) -> tuple[NDArray, list[Any]]:
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
    joined = [(t[0], other) for _, t in shared for other in t[1:] if surfaces.same(t[0], other)]
    i, j = np.array(joined, int).reshape(-1, 2).T
    _, patch = connected_components(coo_matrix((np.ones(len(i)), (i, j)), (len(faces),) * 2), directed=False)
    return patch, [edge for edge, touching in shared if len(set(patch[touching])) > 1]


def _points_on(edge: Any, size: float) -> NDArray:
    """A polyline (k, 3) along an edge, dense where it bends."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GCPnts import GCPnts_TangentialDeflection

    curve = BRepAdaptor_Curve(edge)
    points = GCPnts_TangentialDeflection(curve, 0.2, EDGE_DEVIATION * size, 2)
    return np.array([array(points.Value(k)) for k in range(1, points.NbPoints() + 1)])
