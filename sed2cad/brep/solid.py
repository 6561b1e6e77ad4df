"""From a layout to OCC solids: every vertex and edge is made once and shared by its faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopoDS import (
    TopoDS,
    TopoDS_Edge,
    TopoDS_Face,
    TopoDS_Shell,
    TopoDS_Solid,
    TopoDS_Vertex,
    TopoDS_Wire,
)

from sed2cad.brep.kernel import pnt
from sed2cad.brep.surfaces import curve_of, surface_of
from sed2cad.geometry.layout import Layout, LayoutEdge, LayoutFace

PRECISION = 1e-7  # OCC's own: no tolerance is smaller
_SLACK = 1.1  # tolerances cover the measured deviation with this to spare


@dataclass(frozen=True)
class Body:
    """One connected shell as a solid, and its faces in the order of the layout."""

    solid: TopoDS_Solid
    faces: tuple[TopoDS_Face, ...]
    regions: tuple[int, ...]  # the region of each face


def build_bodies(layout: Layout) -> list[Body]:
    """One solid per body of the layout, in its coordinates. Nothing is checked or repaired yet."""
    edges = _edges(layout)
    bodies = []
    for number in sorted({face.body for face in layout.faces}):
        own = [face for face in layout.faces if face.body == number]
        faces = [_face(face, layout, edges) for face in own]
        bodies.append(Body(solid_of(faces), tuple(faces), tuple(face.region for face in own)))
    return bodies


def solid_of(faces: Sequence[TopoDS_Face]) -> TopoDS_Solid:
    """A solid with one shell of faces that share their edges."""
    builder, shell, solid = BRep_Builder(), TopoDS_Shell(), TopoDS_Solid()
    builder.MakeShell(shell)
    for face in faces:
        builder.Add(shell, face)
    shell.Closed(True)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return solid


def _edges(layout: Layout) -> list[TopoDS_Edge]:
    """All edges with their vertices."""
    builder = BRep_Builder()
    tolerances = [max(_SLACK * edge.residual, PRECISION) for edge in layout.edges]
    vertices = _vertices(layout, tolerances)
    made = []
    for edge, tolerance in zip(layout.edges, tolerances):
        shape = TopoDS_Edge()
        builder.MakeEdge(shape, curve_of(edge.arc.curve), tolerance)
        builder.Range(shape, edge.arc.first, edge.arc.last)
        builder.Add(shape, vertices[edge.start].Oriented(TopAbs_FORWARD))
        builder.Add(shape, vertices[edge.end].Oriented(TopAbs_REVERSED))
        made.append(shape)
    return made


def _vertices(layout: Layout, edge_tolerances: Sequence[float]) -> dict[int, TopoDS_Vertex]:
    """The vertices in use, each with a tolerance that reaches the ends of its edges."""
    reach: dict[int, float] = {}
    for edge, tolerance in zip(layout.edges, edge_tolerances):
        for vertex, end in zip((edge.start, edge.end), edge.arc.ends()):
            gap = _SLACK * float(np.linalg.norm(layout.vertices[vertex] - end))
            reach[vertex] = max(reach.get(vertex, 0.0), gap, tolerance)
    builder = BRep_Builder()
    made = {}
    for vertex, tolerance in reach.items():
        made[vertex] = TopoDS_Vertex()
        builder.MakeVertex(made[vertex], pnt(layout.vertices[vertex]), tolerance)
    return made


def _face(face: LayoutFace, layout: Layout, edges: Sequence[TopoDS_Edge]) -> TopoDS_Face:
    """One face. An inward surface takes its wires reversed and is then reversed itself."""
    builder = BRep_Builder()
    samples = [_samples(layout.edges[e]) for loop in face.loops for e, _ in loop]
    points = np.vstack([face.points, *samples])
    surface = surface_of(face.primitive, face.placement, points)
    made = TopoDS_Face()
    if face.loops:
        builder.MakeFace(made, surface, PRECISION)
    else:
        made = BRepBuilderAPI_MakeFace(surface, PRECISION).Face()
    for loop in face.loops:
        wire = TopoDS_Wire()
        builder.MakeWire(wire)
        for edge, way in loop if face.sign > 0 else [(e, -way) for e, way in reversed(loop)]:
            builder.Add(wire, edges[edge].Oriented(TopAbs_FORWARD if way > 0 else TopAbs_REVERSED))
        wire.Closed(True)
        builder.Add(made, wire)
    return made if face.sign > 0 else TopoDS.Face_s(made.Reversed())


def _samples(edge: LayoutEdge) -> np.ndarray:
    return edge.arc.sampled(25)
