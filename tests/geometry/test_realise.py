"""From chains off a noisy mesh to exact curves."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.geometry.contact import Side
from sed2cad.geometry.edges import edge_geometry
from sed2cad.geometry.meeting import meeting
from sed2cad.geometry.realise import realise
from sed2cad.geometry.web import Web
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.topology.model import Chain
from tests.geometry import parts

X, Y, Z = np.eye(3)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("name", sorted(parts.EXACT))
def test_edges_and_corners_are_exact(name: str, noise: float) -> None:
    part = parts.EXACT[name]().noisy(noise)
    realised = realise(part.topology, part.fitted)
    edges = [edge for edge in realised.edges if edge is not None]
    assert len(edges) == len(part.topology.chains)
    assert all(edge.residual < 1e-9 for edge in edges)
    if not name.startswith("halved"):  # between two halves of a plane only the mesh knows the edge
        assert all(edge.arc.curve.kind in ("line", "circle") for edge in edges)
    assert (realised.corner_residuals < 1e-9).all()


def test_a_saddle_is_interpolated_closely() -> None:
    part = parts.crossing_pipes().noisy(0.005)
    edge = realise(part.topology, part.fitted).edges[3]
    assert edge is not None
    assert edge.arc.curve.kind == "interpolated"
    assert edge.residual < 2e-5


def test_edges_start_and_end_at_their_corners() -> None:
    part = parts.filleted_box().noisy(0.01)
    realised = realise(part.topology, part.fitted)
    for chain, edge in zip(part.topology.chains, realised.edges):
        assert edge is not None
        first, last = edge.arc.ends()
        assert first == pytest.approx(realised.corners[chain.start], abs=1e-9)
        assert last == pytest.approx(realised.corners[chain.end], abs=1e-9)


def test_a_torn_corner_is_mended() -> None:
    part = parts.pyramid()
    peak = len(part.topology.corners) - 1
    top = part.topology.corners[peak]
    torn = Web(part.topology).split(peak, 0, 2, top, top + np.array([0.006, 0.004, -0.003])).topology()
    realised = realise(torn, part.fitted)
    assert realised.edges[-1] is None
    assert realised.clusters[-1] == realised.clusters[peak]
    assert realised.corners[-1] == pytest.approx(top, abs=1e-9)


def test_a_short_real_edge_is_kept() -> None:
    size = (30.0, 20.0, 0.5)  # the wall is 1.4 % of the diagonal high
    part = parts.box(size)
    assert all(edge is not None for edge in realise(part.topology, part.fitted).edges)


def test_a_tiny_edge_is_kept_where_it_was_traced_exactly() -> None:
    part = parts.hip_roof(0.03)  # a thousandth of the diagonal
    assert all(edge is not None for edge in realise(part.topology, part.fitted).edges)
    rough = part.noisy(0.001)
    assert sum(edge is None for edge in realise(rough.topology, rough.fitted).edges) == 1


def _chain(angle: float) -> np.ndarray:
    return np.column_stack(
        [np.full(20, 0.1 * np.sin(angle)), np.linspace(0, 0.3, 20), np.full(20, 0.1 * np.cos(angle))]
    )


def test_a_short_chain_may_stray_off_where_tangent_surfaces_touch() -> None:
    """Of surfaces that cross at such an angle the shapes say so."""
    cylinder, chain = Side(Cylinder(Y, np.zeros(3), 0.1), 1), _chain(np.radians(20))
    assert meeting(Side(Plane(Z, 0.1), 1), cylinder, chain) == "touching"
    assert meeting(Side(Plane(Z, 0.1 * np.cos(np.radians(20))), 1), cylinder, chain) == "crossing"
    assert meeting(Side(Plane(Z, 0.1), 1), cylinder, _chain(np.radians(60))) == "crossing"


def test_crossing_touching_resting() -> None:
    cylinder = Side(Cylinder(Y, np.zeros(3), 0.1), 1)
    assert meeting(Side(Plane(X, 0.05), 1), cylinder, _chain(np.pi / 6)) == "crossing"
    assert meeting(Side(Plane(Z, 0.1), 1), cylinder, _chain(np.radians(5))) == "touching"
    shallow = Side(Plane(Z, 0.1 * np.cos(np.radians(13))), 1)  # cuts a thin slice off
    assert meeting(shallow, cylinder, _chain(np.radians(13))) == "crossing"
    assert meeting(cylinder, cylinder, _chain(0.3)) == "resting"
    draft = Side(Plane(np.array([np.sin(0.1), 0.0, np.cos(0.1)]), 0.1), 1)
    assert meeting(Side(Plane(Z, 0.1), 1), draft, np.outer(np.linspace(0, 0.3, 20), Y) + 0.1 * Z) == "crossing"


def test_a_closed_edge_is_no_line() -> None:
    a, b = Side(Plane(Z, 0.0), 1), Side(Plane(X, 0.0), 1)
    ring = parts.circle((0, 0, 0), Z, 0.01)(np.linspace(0, 2 * np.pi, 40, endpoint=False))
    edge = edge_geometry(Chain(ring, 0, 1, -1, -1), a, b, "crossing", np.zeros((0, 3)))
    assert edge.arc.curve.kind != "line"
    assert np.allclose(*edge.arc.ends(), atol=1e-9)
