"""Control nets as faces: exact in the kernel and in STEP, wherever a closed one is cut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.GeomAbs import GeomAbs_BSplineSurface, GeomAbs_Plane

from sed2cad.brep.attempt import Attempt
from sed2cad.brep.build import assemble
from sed2cad.brep.freeform import cut_open
from sed2cad.brep.kernel import Array, faces, from_bytes, is_closed, is_valid, volume
from sed2cad.brep.step import read_step, write_step
from sed2cad.brep.surfaces import surface_of
from sed2cad.geometry.layout import Placement
from sed2cad.primitives.freeform_fit import fit_freeform
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.vectors import unit
from sed2cad.training.cad_mesh import evaluate, faces_of
from tests.geometry import parts
from tests.primitives.sheets import flank, hose


@pytest.fixture(scope="module")
def tube() -> NetSurface:
    found = fit_freeform(*hose(3000))
    assert isinstance(found, NetSurface) and found.closed
    return found


@pytest.mark.parametrize("seam", [0.0, 0.123, 0.7])
def test_the_net_is_exact_wherever_it_is_cut(tube: NetSurface, seam: float) -> None:
    net, *_, closed = cut_open(tube, seam)
    assert closed and net[0] == pytest.approx(net[-1], abs=1e-12)
    surface = surface_of(tube, Placement(np.zeros(3), np.eye(3)[2], np.eye(3)[0], seam=seam), np.zeros((0, 3)))
    rng, (low, high) = np.random.default_rng(0), tube.domain
    uv = rng.uniform(0, 1, (50, 2)) * [tube.period, high[1] - low[1]] + [0, low[1]]
    start = low[0] + seam * tube.period
    own = tube.at(np.column_stack([low[0] + np.mod(uv[:, 0] + start - low[0], tube.period), uv[:, 1]]))
    kernel = np.array([surface.Value(u, v).Coord() for u, v in uv.tolist()])
    assert kernel == pytest.approx(own, abs=1e-10)


@pytest.mark.parametrize("sheet", [flank, hose])
def test_a_face_survives_step(sheet, tmp_path: Path) -> None:
    net = fit_freeform(*sheet(2000))
    assert isinstance(net, NetSurface)
    placement = Placement(np.zeros(3), np.eye(3)[2], np.eye(3)[0])
    face = BRepBuilderAPI_MakeFace(surface_of(net, placement, np.zeros((0, 3))), 1e-7).Face()
    write_step(face, tmp_path / "face.step")
    (again,) = faces_of(read_step(tmp_path / "face.step"))
    (u_low, v_low), (u_high, v_high) = net.domain
    uv = np.random.default_rng(0).uniform([u_low + 1e-3, v_low], [u_high - 1e-3, v_high], (40, 2))
    points, normals = evaluate(again, uv if not net.closed else uv - [u_low, 0])
    assert net.distance(points) == pytest.approx(0, abs=1e-6)
    assert np.abs(np.einsum("ij,ij->i", normals, net.normal(points))).min() > 0.9999


def test_a_bent_hose_becomes_a_solid(tube: NetSurface) -> None:
    """Pappus: a disc along a plane curve sweeps its area times the curve's length."""
    b = parts.Builder()
    sign = tube.side(*hose(200, 1))
    ends = [(np.array([x, 0.2 * np.sin(4 * x), 0.0]), unit(np.array([1.0, 0.8 * np.cos(4 * x), 0.0]))) for x in (0, 1)]
    side = b.face(tube.scaled(100.0, np.zeros(3)), sign)
    for (centre, way), out in zip(ends, (-1, 1)):
        cap = b.face(Plane(out * way, float(out * way @ centre * 100)))
        b.ring(_rim(100 * centre, out * way), cap, side)
    x = np.linspace(0, 1, 20001)
    length = float(np.trapezoid(np.sqrt(1 + 0.64 * np.cos(4 * x) ** 2), x))
    truth = np.pi * 5.0**2 * 100 * length
    part = b.part(truth, 2 * np.pi * 5 * 100 * length, box=((0, -20, -5), (100, 25, 5)))
    result = assemble(Attempt(part.topology, part.fitted, part.frame, part.points))
    solid = from_bytes(result.brep)
    assert is_valid(solid) and is_closed(solid)
    kinds = [BRepAdaptor_Surface(face).GetType() for face in faces(solid)]
    assert kinds == [GeomAbs_BSplineSurface, GeomAbs_Plane, GeomAbs_Plane]
    assert volume(solid) == pytest.approx(truth, rel=1e-3)


def _rim(centre: Array, out: Array):
    """The circle of radius 5 around a point of the spine, counter-clockwise about `out`."""
    y = np.array([0.0, 0, 1])
    x = np.cross(y, out)
    return lambda t: centre + 5 * (np.outer(np.cos(t), x) + np.outer(np.sin(t), y))
