"""Fillets and chamfers of constant size on some edges of a part; what the kernel cannot do is left out."""

from __future__ import annotations

from dataclasses import dataclass

from build123d import Edge, GeomType, Solid
from OCP.BRep import BRep_Tool
from OCP.BRepLib import BRepLib
from OCP.GeomAbs import GeomAbs_C0
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape, TopTools_IndexedMapOfShape

from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.shapes import diagonal, is_sound, largest

MOST_EDGES = 24
"""More edges at once take seconds."""


@dataclass(frozen=True)
class SharpEdge:
    """An edge where two faces meet at an angle, and the numbers of these faces."""

    edge: Edge
    faces: tuple[int, int]


def sharp_edges(part: Solid) -> list[SharpEdge]:
    """The edges that can be rounded: between two faces that are not tangent there."""
    BRepLib.EncodeRegularity_s(part.wrapped)
    owners = TopTools_IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndAncestors_s(part.wrapped, TopAbs_EDGE, TopAbs_FACE, owners)
    numbers = TopTools_IndexedMapOfShape()
    found = []
    for k in range(1, owners.Extent() + 1):
        edge, faces = TopoDS.Edge_s(owners.FindKey(k)), list(owners.FindFromIndex(k))
        ids = [numbers.Add(face) for face in faces]
        if len(set(ids)) != 2 or BRep_Tool.Degenerated_s(edge):
            continue
        if BRep_Tool.Continuity_s(edge, TopoDS.Face_s(faces[0]), TopoDS.Face_s(faces[1])) == GeomAbs_C0:
            found.append(SharpEdge(Edge(edge), (ids[0], ids[1])))
    return found


def group(dice: Dice, edges: list[SharpEdge]) -> list[Edge]:
    """Edges that a designer would round together: parallel, equal circles, around a face, at a corner, or any."""
    kind = dice.pick(["parallel", "circles", "face", "corner", "any"], [3, 3.5, 3, 2.5, 1.5])
    first = dice.pick(edges)
    circles = [e.edge for e in edges if e.edge.geom_type == GeomType.CIRCLE]
    lines = [e.edge for e in edges if e.edge.geom_type == GeomType.LINE]
    if kind == "parallel" and lines:
        along = dice.pick(lines).tangent_at(0.5)
        return [e for e in lines if abs(e.tangent_at(0.5).dot(along)) > 0.999][:MOST_EDGES]
    if kind == "circles" and circles:
        radius = dice.pick(circles).radius
        return [e for e in circles if abs(e.radius - radius) < 1e-6][:MOST_EDGES]
    if kind == "face":
        face = dice.pick(first.faces)
        return [e.edge for e in edges if face in e.faces][:MOST_EDGES]
    if kind == "corner":
        tip = first.edge @ 0
        return [e.edge for e in edges if min((e.edge @ 0 - tip).length, (e.edge @ 1 - tip).length) < 1e-6]
    return [e.edge for e in dice.some(edges, 6)]


def dress(
    dice: Dice, part: Solid, rounds: int, fillets: float = 0.5, size: tuple[float, float] = (0.006, 0.04)
) -> Solid:
    """Round (with a probability of `fillets`) or bevel up to `rounds` groups of edges; sizes in diagonals."""
    for _ in range(rounds):
        edges = sharp_edges(part)
        if not edges:
            break
        chosen, fillet = group(dice, edges), dice.rounded and dice.chance(fillets)
        if not fillet and not dice.conical:
            chosen = [edge for edge in chosen if edge.geom_type == GeomType.LINE]
        if not chosen:
            continue
        shortest = min(edge.length for edge in chosen)
        radius = min(dice.spread(*size) * diagonal(part), 0.4 * shortest)
        part = _dressed(part, chosen, radius, fillet)
    return part


def _dressed(part: Solid, edges: list[Edge], radius: float, fillet: bool) -> Solid:
    """The part with the edges dressed, with a smaller radius if need be, or as it was."""
    for size in (radius, 0.35 * radius):
        try:
            made = part.fillet(size, edges) if fillet else part.chamfer(size, None, edges)
            solid = largest(made.wrapped)
        except Exception:  # the kernel raises its own errors of many kinds: go on without
            continue
        if is_sound(solid) and 0.6 < solid.volume / part.volume < 1.3:
            return solid
    return part
