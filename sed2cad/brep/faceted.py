"""A closed mesh as a solid of planar triangles that share their edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Builder
from OCP.Geom import Geom_Line, Geom_Plane
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Vertex, TopoDS_Wire
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sed2cad.brep.bodies import BodyShape
from sed2cad.brep.kernel import Array, direction, faces, is_closed, is_valid, pnt, volume
from sed2cad.brep.solid import PRECISION, solid_of
from sed2cad.errors import AssemblyError
from sed2cad.scan.scan import Mesh

_FLAT = 1e-6  # of the diagonal: how far merged triangles may lie from one plane
_FLAT_ANGLE = 1e-3  # radians


def faceted_bodies(mesh: Mesh, diagonal: float, merge: bool) -> list[BodyShape]:
    """One solid per connected component; those whose triangles face inwards are cavities.

    AssemblyError where the mesh is not closed.
    """
    sides = np.vstack([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    pairs, twin, count = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    if len(mesh.faces) == 0 or (count != 2).any():
        raise AssemblyError("the mesh is not closed, so no faceted solid can be made of it")
    twin = twin.reshape(3, -1).T  # (f, 3): the pair of each side
    links = coo_array((np.ones(len(sides)), (sides[:, 0], sides[:, 1])), shape=(len(mesh.vertices),) * 2)
    component = connected_components(links, directed=False)[1][mesh.faces[:, 0]]
    bodies = []
    for number in np.unique(component):
        chosen = np.flatnonzero(component == number)
        cavity = Mesh(mesh.vertices, mesh.faces[chosen]).volume() < 0
        shape = _solid(mesh, chosen, pairs, twin, flip=cavity)
        if merge:
            shape = _merged(shape, diagonal)
        bodies.append(BodyShape(shape, (-1,) * len(faces(shape)), cavity))
    return bodies


def _solid(
    mesh: Mesh, chosen: NDArray[np.int64], pairs: NDArray[np.int64], twin: NDArray[np.int64], flip: bool
) -> TopoDS_Shape:
    """The solid of some triangles."""
    points = mesh.vertices
    edges = _edges(points, pairs, np.unique(twin[chosen]))
    made = []
    for number in chosen:
        corners, sides = mesh.faces[number], twin[number]
        ways = corners == pairs[sides, 0]  # each side starts at its triangle's corner
        if flip:
            corners, sides, ways = corners[::-1], sides[::-1], ~ways[::-1]
        made.append(_triangle(points[corners], [edges[s] for s in sides], ways))
    return solid_of(made)


def _edges(points: Array, pairs: NDArray[np.int64], used: NDArray[np.int64]) -> dict[int, TopoDS_Edge]:
    """Straight edges between vertices, each once."""
    builder = BRep_Builder()
    vertices = {}
    for v in np.unique(pairs[used]):
        vertices[int(v)] = TopoDS_Vertex()
        builder.MakeVertex(vertices[int(v)], pnt(points[v]), PRECISION)
    edges = {}
    for number in used:
        a, b = (int(v) for v in pairs[number])
        way = points[b] - points[a]
        edge = TopoDS_Edge()
        builder.MakeEdge(edge, Geom_Line(pnt(points[a]), direction(way)), PRECISION)
        builder.Range(edge, 0.0, float(np.linalg.norm(way)))
        builder.Add(edge, vertices[a].Oriented(TopAbs_FORWARD))
        builder.Add(edge, vertices[b].Oriented(TopAbs_REVERSED))
        edges[int(number)] = edge
    return edges


def _triangle(corners: Array, edges: Sequence[TopoDS_Edge], ways: NDArray[np.bool_]) -> TopoDS_Face:
    """A planar face; each edge runs its own way or against it."""
    builder, face, wire = BRep_Builder(), TopoDS_Face(), TopoDS_Wire()
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    builder.MakeFace(face, Geom_Plane(pnt(corners.mean(axis=0)), direction(normal)), PRECISION)
    builder.MakeWire(wire)
    for edge, forward in zip(edges, ways):
        builder.Add(wire, edge.Oriented(TopAbs_FORWARD if forward else TopAbs_REVERSED))
    wire.Closed(True)
    builder.Add(face, wire)
    return face


def _merged(shape: TopoDS_Shape, diagonal: float) -> TopoDS_Shape:
    """Coplanar triangles as one face, where the result is still the same closed valid solid."""
    tool = ShapeUpgrade_UnifySameDomain(shape, True, True, False)
    tool.SetLinearTolerance(_FLAT * diagonal)
    tool.SetAngularTolerance(_FLAT_ANGLE)
    try:
        tool.Build()
    except RuntimeError:
        return shape
    merged = tool.Shape()
    same = np.isclose(volume(merged), volume(shape), rtol=1e-4)
    return merged if same and is_closed(merged) and is_valid(merged) else shape
