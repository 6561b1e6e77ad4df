"""Solids with extruded and turned spline profiles: closed, valid, of the right size, swept in the STEP file."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.Geom import Geom_Surface
from OCP.GeomAbs import GeomAbs_Plane, GeomAbs_SurfaceOfExtrusion, GeomAbs_SurfaceOfRevolution
from OCP.gp import gp_Pnt, gp_Vec

from sed2cad.brep.attempt import AssemblyResult, Attempt, nowhere
from sed2cad.brep.build import assemble
from sed2cad.brep.kernel import faces, from_bytes, is_closed, is_valid, volume
from sed2cad.brep.measure import tessellate
from sed2cad.brep.step import read_step, write_step
from sed2cad.brep.surfaces import surface_of
from sed2cad.geometry.layout import Draft
from sed2cad.geometry.realise import realise
from sed2cad.geometry.seams import place
from tests.geometry import swept_parts
from tests.geometry.parts import Array, Part

KINDS = {
    GeomAbs_Plane: "plane",
    GeomAbs_SurfaceOfExtrusion: "extrusion",
    GeomAbs_SurfaceOfRevolution: "revolution",
}


@cache
def made(name: str) -> Part:
    return swept_parts.SWEPT[name]()


@cache
def solid(name: str) -> AssemblyResult:
    part = made(name).noisy(0.003)
    return assemble(Attempt(part.topology, part.fitted, part.frame, nowhere()))


def volume_inside(shape) -> float:
    """By fine triangles: the kernel's own integral is 0.2 % off on extruded splines."""
    a, b, c = tessellate(shape, 0.01).corners()
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def kinds(shape) -> list[str]:
    return [KINDS[BRepAdaptor_Surface(face).GetType()] for face in faces(shape)]


@pytest.mark.parametrize("name", sorted(swept_parts.SWEPT))
def test_the_solid_is_closed_swept_and_of_the_right_size(name: str, tmp_path: Path) -> None:
    part, result = made(name), solid(name)
    assert result.gate.passed
    assert result.gate.max_tolerance < 3e-5 * part.frame.scale
    assert tuple(face.kind for face in result.faces) == part.kinds
    assert {face.rung for face in result.faces if face.kind != "plane"} == {"swept"}
    shape = from_bytes(result.brep)
    assert kinds(shape) == list(part.kinds)
    assert volume_inside(shape) == pytest.approx(part.volume, rel=2e-3)
    path = tmp_path / "part.step"
    write_step(shape, path)
    back = read_step(path)
    assert is_valid(back) and is_closed(back)
    assert kinds(back) == list(part.kinds)
    assert volume_inside(back) == pytest.approx(part.volume, rel=2e-3)


def test_the_step_file_says_what_is_swept(tmp_path: Path) -> None:
    for name, word in (("tube", "SURFACE_OF_LINEAR_EXTRUSION("), ("vase", "SURFACE_OF_REVOLUTION(")):
        write_step(from_bytes(solid(name).brep), tmp_path / "part.step")
        assert (tmp_path / "part.step").read_text().count(word) == made(name).kinds.count(made(name).kinds[0])


@pytest.mark.parametrize("name", ["tube", "wavy_bar", "vase", "quarter_ring", "dome"])
def test_the_natural_normal_is_the_primitives(name: str) -> None:
    part = made(name)
    for face in place(Draft(realise(part.topology, part.fitted), part.fitted)).faces:
        if face.primitive.kind == "plane":
            continue
        surface = surface_of(face.primitive, face.placement, face.points)
        low_u, high_u, low_v, high_v = bounds(surface)
        rng = np.random.default_rng(0)
        for u, v in zip(rng.uniform(low_u, high_u, 20), rng.uniform(low_v, high_v, 20)):
            point, natural = at(surface, u, v)
            assert abs(face.primitive.distance(point[None])[0]) < 1e-9
            assert face.primitive.normal(point[None])[0] == pytest.approx(natural, abs=1e-6)


def bounds(surface: Geom_Surface) -> tuple[float, float, float, float]:
    first, last, low, high = surface.Bounds()
    return first, last, max(low, -1.0), min(high, 1.0)


def at(surface: Geom_Surface, u: float, v: float) -> tuple[Array, Array]:
    """The point (3,) and the natural normal (3,) there."""
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    surface.D1(u, v, point, along_u, along_v)
    normal = along_u.Crossed(along_v)
    vector = np.array([normal.X(), normal.Y(), normal.Z()])
    return np.array([point.X(), point.Y(), point.Z()]), vector / np.linalg.norm(vector)


def test_a_closed_wall_has_its_seam_at_a_vertex() -> None:
    part = made("tube")
    layout = place(Draft(realise(part.topology, part.fitted), part.fitted))
    for face in layout.faces:
        if face.primitive.kind != "extrusion":
            continue
        seam = face.placement.origin
        for loop in face.loops:
            starts = np.array([layout.vertices[layout.edges[e].start] for e, _ in loop])
            across = starts - seam - ((starts - seam) @ face.placement.z)[:, None] * face.placement.z
            assert np.linalg.norm(across, axis=1).min() < 1e-5




def test_the_kernel_integrates_extruded_splines_badly() -> None:
    """OCP 7.9: BRepGProp takes few points per surface, whatever its knots. Gone: `volume` is exact here too."""
    error = volume(from_bytes(solid("tube").brep)) / made("tube").volume - 1
    assert 1e-3 < abs(error) < 1e-2
