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
    TopoDS_Shape,
    TopoDS_Shell,
    TopoDS_Solid,
    TopoDS_Vertex,
    TopoDS_Wire,
)

from sed2cad.brep.caps import cap_edges
from sed2cad.brep.kernel import pnt
from sed2cad.brep.surfaces import curve_of, surface_of
from sed2cad.geometry.layout import Layout, LayoutEdge, LayoutFace, Loop

Vertices = dict[int, TopoDS_Vertex]

PRECISION = 1e-7  # OCC's own: no tolerance is smaller
_SLACK = 1.1  # tolerances cover the measured deviation with this to spare


@dataclass(frozen=True)
class Body:
    """One connected shell, as a solid if it is closed, and its faces in the order of the layout."""

    shape: TopoDS_Shape
    faces: tuple[TopoDS_Face, ...]
    regions: tuple[int, ...]  # the region of each face
    is_open: bool = False


def build_bodies(layout: Layout) -> list[Body]:
    """The bodies of the layout, in its coordinates. Nothing is checked or repaired yet."""
    vertices = _vertices(layout)
    edges = _edges(layout, vertices)
    bodies = []
    for number in sorted({face.body for face in layout.faces}):
        own = [face for face in layout.faces if face.body == number]
        faces = [_face(face, layout, vertices, edges) for face in own]
        is_open = number in layout.open_bodies
        shape = shell_of(faces) if is_open else solid_of(faces)
        bodies.append(Body(shape, tuple(faces), tuple(face.region for face in own), is_open))
    return bodies


def solid_of(faces: Sequence[TopoDS_Face]) -> TopoDS_Solid:
    """A solid with one shell of faces that share their edges."""
    builder, shell, solid = BRep_Builder(), shell_of(faces), TopoDS_Solid()
    shell.Closed(True)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return solid


def shell_of(faces: Sequence[TopoDS_Face]) -> TopoDS_Shell:
    """A shell of faces that share their edges."""
    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    for face in faces:
        builder.Add(shell, face)
    return shell


def _tolerance(edge: LayoutEdge) -> float:
    return max(_SLACK * edge.residual, PRECISION)


def _edges(layout: Layout, vertices: Vertices) -> list[TopoDS_Edge]:
    """All edges with their vertices."""
    builder = BRep_Builder()
    made = []
    for edge in layout.edges:
        shape = TopoDS_Edge()
        builder.MakeEdge(shape, curve_of(edge.arc.curve), _tolerance(edge))
        builder.Range(shape, edge.arc.first, edge.arc.last)
        builder.Add(shape, vertices[edge.start].Oriented(TopAbs_FORWARD))
        builder.Add(shape, vertices[edge.end].Oriented(TopAbs_REVERSED))
        made.append(shape)
    return made


def _vertices(layout: Layout) -> Vertices:
    """The vertices in use, each with a tolerance that reaches the ends of its edges."""
    reach: dict[int, float] = {}
    for edge in layout.edges:
        for vertex, end in zip((edge.start, edge.end), edge.arc.ends()):
            gap = _SLACK * float(np.linalg.norm(layout.vertices[vertex] - end))
            reach[vertex] = max(reach.get(vertex, 0.0), gap, _tolerance(edge))
    builder = BRep_Builder()
    made = {}
    for vertex, tolerance in reach.items():
        made[vertex] = TopoDS_Vertex()
        builder.MakeVertex(made[vertex], pnt(layout.vertices[vertex]), tolerance)
    return made


def _face(face: LayoutFace, layout: Layout, vertices: Vertices, edges: Sequence[TopoDS_Edge]) -> TopoDS_Face:
    """One face. An inward surface takes its wires reversed and is then reversed itself."""
    samples = [layout.edges[e].arc.sampled(25) for loop in face.loops for e, _ in loop]
    surface = surface_of(face.primitive, face.placement, np.vstack([face.points, *samples]))
    if not face.loops:
        made = BRepBuilderAPI_MakeFace(surface, PRECISION).Face()
        return made if face.sign > 0 else TopoDS.Face_s(made.Reversed())
    builder, made = BRep_Builder(), TopoDS_Face()
    builder.MakeFace(made, surface, PRECISION)
    for number, loop in enumerate(face.loops):
        wire = TopoDS_Wire()
        builder.MakeWire(wire)
        for piece in _wire_edges(face, number, loop, layout, vertices, edges, made):
            builder.Add(wire, piece)
        wire.Closed(True)
        builder.Add(made, wire)
    return made if face.sign > 0 else TopoDS.Face_s(made.Reversed())


def _wire_edges(
    face: LayoutFace,
    number: int,
    loop: Loop,
    layout: Layout,
    vertices: Vertices,
    edges: Sequence[TopoDS_Edge],
    made: TopoDS_Face,
) -> list[TopoDS_Shape]:
    """The oriented edges of a loop; the ring of a cap goes on to the pole and back."""
    steps = list(loop) if face.sign > 0 else [(e, -way) for e, way in reversed(loop)]
    pole = face.placement.pole
    capped = pole is not None and pole.loop == number
    if pole is not None and capped:
        first = [_origin_of(layout.edges[e], way) for e, way in steps].index(pole.vertex)
        steps = steps[first:] + steps[:first]
    pieces = [edges[e].Oriented(TopAbs_FORWARD if way > 0 else TopAbs_REVERSED) for e, way in steps]
    if pole is not None and capped:
        at = layout.vertices[pole.vertex]
        pieces += cap_edges(made, face.primitive, face.placement, vertices[pole.vertex], at)
    return pieces


def _origin_of(edge: LayoutEdge, way: int) -> int:
    """The vertex where a step along an edge begins."""
    return edge.start if way > 0 else edge.end
