"""From the points and true patches of parts with swept faces to closed solids that have these faces."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.assembly import Assembler
from sed2cad.completion.complete import Completed
from sed2cad.fitting import fit_patches
from sed2cad.joining import joined
from sed2cad.model import CadModel
from sed2cad.primitives.base import Array, Patch
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.vectors import unit
from sed2cad.report.summary import summarise
from sed2cad.scan.scan import Frame, Scan
from sed2cad.settings import Settings
from tests.geometry.parts import Z
from tests.geometry.swept_parts import VASE, WAVE, turned_volume, vase, wavy_bar

NOISE = 2e-4  # unit frame


def spread(count: int) -> tuple[Array, Array]:
    """Pairs of numbers in 0 .. 1, even over the square (Roberts 2018, the R2 sequence): a, b (count,)."""
    a, b = (np.arange(1, count + 1)[:, None] * [0.7548776662466927, 0.5698402909980532] % 1.0).T
    return a, b


def disc(radius: float, height: float) -> Array:
    a, b = spread(400)
    r, angle = radius * np.sqrt(a), 2 * np.pi * b
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(400, height)])


def vase_points() -> list[tuple[Array, Array]]:
    """Points and outward normals of wall, top and bottom of the vase, its wall in two patches."""
    wall = Revolution(Z, np.zeros(3), VASE)
    t = np.linspace(*VASE.ends, 2000)
    share = np.cumsum(VASE.at(t)[:, 0])
    a, b = spread(2500)
    flat, angle = VASE.at(np.interp(a * share[-1], share, t)), 2 * np.pi * b
    points = np.column_stack([flat[:, 0] * np.cos(angle), flat[:, 0] * np.sin(angle), flat[:, 1]])
    normals, low = wall.normal(points), points[:, 2] < 9.0
    sides = [(points[own], normals[own]) for own in (low, ~low)]
    return [*sides, (disc(6.5, 20.0), np.tile(Z, (400, 1))), (disc(5.0, 0.0), np.tile(-Z, (400, 1)))]


def bar_points() -> list[tuple[Array, Array]]:
    """Points and outward normals of the faces of the wavy bar."""
    rng = np.random.default_rng(2)
    front = Extrusion(Z, np.zeros(3), np.array([1.0, 0.0, 0.0]), WAVE)
    cloud = rng.uniform([0, -3, 0], [24, 10, 8], (20_000, 3))
    cloud = cloud[front.distance(cloud) < 0]
    wave = WAVE.at(rng.uniform(*WAVE.ends, 900))
    wall = np.column_stack([wave, rng.uniform(0, 8, 900)])
    faces = [(wall, front.normal(wall))]
    for normal, offset in ((X, 24.0), (Y, 10.0), (-X, 0.0), (Z, 8.0), (-Z, 0.0)):
        side = np.abs(normal)
        some = cloud[rng.choice(len(cloud), 600, replace=False)]
        some = some - (some @ normal - offset)[:, None] * normal
        faces.append((some[front.distance(some) < 0] if side[1] == 0 else some, normal))
    return [(p, np.broadcast_to(n, p.shape)) for p, n in faces]


X, Y = np.eye(3)[:2]


def scan_of(faces: list[tuple[Array, Array]], frame: Frame, kinds: list[str]) -> tuple[Scan, list[Patch]]:
    """The faces with noise, in the unit frame, and their patches."""
    rng = np.random.default_rng(5)
    points = np.vstack([frame.to_unit(p) for p, _ in faces])
    normals = np.vstack([n for _, n in faces])
    points = points + NOISE * rng.normal(size=(len(points), 1)) * normals
    ends = np.cumsum([0, *(len(p) for p, _ in faces)])
    patches = [
        Patch(np.arange(a, b), kind, np.ones(b - a, bool)) for a, b, kind in zip(ends[:-1], ends[1:], kinds)
    ]
    return Scan(points, unit(normals), None, frame, NOISE, 0.01), patches


@pytest.mark.parametrize("name", ["vase", "wavy_bar"])
def test_a_scan_becomes_a_solid_with_swept_faces(name: str) -> None:
    if name == "vase":
        part, faces = vase(), vase_points()
        kinds, swept, volume = ["bspline"] * 2 + ["plane"] * 2, "revolution", turned_volume(VASE)
    else:
        part, faces = wavy_bar(), bar_points()
        kinds, swept, volume = ["bspline"] + ["plane"] * 5, "extrusion", part.volume
    scan, patches = scan_of(faces, part.frame, kinds)
    fitted = joined(scan, fit_patches(scan, patches))
    assert [patch.primitive.kind for patch in fitted] == [swept] + ["plane"] * (len(part.kinds) - 1)
    found = Assembler(Settings(), lambda stage, message: None).best(Completed(scan, fitted))
    assert found.solid.gate.passed and found.rung == "exact"
    assert sorted(found.face_names) == sorted(part_names(part.kinds))
    assert found.solid.gate.volume == pytest.approx(volume, rel=5e-3)
    assert any(constraint.kind == "parallel" and constraint.patches[1] == 0 for constraint in found.constraints)
    report = summarise(found, Completed(scan, fitted), (), ())
    assert {face.name: face.rung for face in report.face_list}[f"{swept}_1"] == "swept"
    model = CadModel(
        name, "mm", scan.frame, found.fitted, found.topology, found.solid.brep, found.face_names, report
    )
    way = "axis" if swept == "revolution" else "direction"
    same = model.vary(**{f"{swept}_1": {way: model.primitives[f"{swept}_1"].parameters()[way]}})
    assert same.report.volume == pytest.approx(volume, rel=5e-3)


def part_names(kinds: tuple[str, ...]) -> list[str]:
    count: dict[str, int] = {}
    names = []
    for kind in kinds:
        count[kind] = count.get(kind, 0) + 1
        names.append(f"{kind}_{count[kind]}")
    return names
