"""Faces that are valid to the kernel, yet open in the eyes of everybody who draws them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from OCP.BRep import BRep_Builder
from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Vertex, TopoDS_Wire

from sed2cad.brep.drawn import undrawn
from sed2cad.brep.kernel import is_valid, pnt
from sed2cad.brep.surfaces import curve_of, surface_of
from sed2cad.geometry.contact import Side
from sed2cad.geometry.curves import Arc, Curve, Interpolated, Line
from sed2cad.geometry.edges import EdgeGeometry, bent
from sed2cad.geometry.layout import Placement
from sed2cad.geometry.realise import realise
from sed2cad.primitives.plane import Plane
from tests.brep.made import part, shape
from tests.geometry import parts

X, Y, Z = np.eye(3)


def leaf(overshoot: float) -> TopoDS_Face:
    """A flat triangle of size 1 with one bowed edge; that one ends so far beyond its neighbour, across it."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    bow = np.array([[1 + overshoot, 1, 0], [0.9, 0.7, 0], [0.5, 0.3, 0], [0, 0, 0]])
    curves: list[tuple[Curve, float]] = [(Line(corners[0], X), 1.0), (Line(corners[1], Y), 1.0)]
    bowed = Interpolated(bow, False)
    curves.append((bowed, bowed.length))
    builder, face, wire = BRep_Builder(), TopoDS_Face(), TopoDS_Wire()
    builder.MakeFace(face, surface_of(Plane(Z, 0.0), Placement(np.zeros(3), Z, X), corners), 1e-7)
    builder.MakeWire(wire)
    vertices = [TopoDS_Vertex() for _ in corners]
    for vertex, corner in zip(vertices, corners):
        builder.MakeVertex(vertex, pnt(corner), max(5 * overshoot, 1e-7))
    for k, (curve, last) in enumerate(curves):
        edge = TopoDS_Edge()
        builder.MakeEdge(edge, curve_of(curve), 1e-7)
        builder.Range(edge, 0.0, last)
        builder.Add(edge, vertices[k].Oriented(TopAbs_FORWARD))
        builder.Add(edge, vertices[(k + 1) % 3].Oriented(TopAbs_REVERSED))
        builder.Add(wire, edge)
    wire.Closed(True)
    builder.Add(face, wire)
    return face


def test_edges_that_cross_beside_a_corner_hide_the_face() -> None:
    assert undrawn(leaf(0.0), np.sqrt(2)) == ()
    crossed = leaf(0.02)
    assert is_valid(crossed)  # the vertex's tolerance covers it
    assert undrawn(crossed, np.sqrt(2)) == (0,)


@pytest.mark.parametrize("name", ["box_with_hole", "filleted_box", "grooved_shaft", "pill"])
def test_exact_parts_are_drawn_whole(name: str) -> None:
    assert undrawn(shape(name), part(name).frame.scale) == ()


def test_bent_edges_end_at_their_corners() -> None:
    given = parts.pyramid()
    primitive = given.fitted[1].primitive
    assert isinstance(primitive, Plane)
    off = replace(given.fitted[1], primitive=Plane(primitive.normal_vector, primitive.offset + 1e-3))
    fitted = (given.fitted[0], off, *given.fitted[2:])

    def gap(bend: bool) -> float:
        made = realise(given.topology, fitted, bend)
        ends = [
            np.linalg.norm(end - made.corners[corner])
            for chain, edge in zip(made.topology.chains, made.edges)
            if edge is not None
            for end, corner in zip(edge.arc.ends(), (chain.start, chain.end))
        ]
        return float(max(ends))

    assert gap(False) > 1e-4
    assert gap(True) < 1e-12


def test_an_edge_that_meets_its_corners_stays_exact() -> None:
    a, b = Side(Plane(Z, 0.0), 1), Side(Plane(Y, 0.0), 1)
    edge = EdgeGeometry(Arc(Line(np.zeros(3), X), 0.0, 1.0), 0.0)
    assert bent(edge, a, b, np.zeros(3), X) is edge
    moved = bent(edge, a, b, np.zeros(3), X + 1e-3 * Z)
    assert moved.residual == pytest.approx(1e-3, rel=1e-6)
    assert np.allclose(moved.arc.ends()[1], X + 1e-3 * Z, atol=1e-12)
