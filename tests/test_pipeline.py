"""The whole way, on a part whose dimensions are known."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sed2cad
from sed2cad import CadModel
from sed2cad.climbing import Climb
from sed2cad.errors import AssemblyError, UsageError
from sed2cad.pipeline import Clock, reconstruct_from
from sed2cad.primitives.base import Patch
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.segment import Segmentation
from sed2cad.settings import Settings
from tests.parts import DATA, bracket
from tests.segmentation.shapes import box

BRACKET = DATA / "bracket.ply"


@pytest.fixture(scope="module")
def model() -> CadModel:
    return sed2cad.reconstruct(BRACKET)


def bore(model: CadModel, radius: float) -> str:
    """The name of the cylinder of this radius."""
    found = [n for n, p in model.primitives.items() if p.kind == "cylinder" and abs(p.radius - radius) < 0.05]
    assert len(found) == 1
    return found[0]


def cylinder_radii(solid: Any) -> list[float]:
    """Radii of the cylindrical faces, measured on the solid."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Cylinder

    surfaces = [BRepAdaptor_Surface(face.wrapped) for face in solid.faces()]
    return sorted(s.Cylinder().Radius() for s in surfaces if s.GetType() == GeomAbs_Cylinder)


def test_bracket_is_exact(model: CadModel) -> None:
    true = bracket()
    assert model.report.closed and model.report.rung == "exact"
    assert model.report.faces == model.report.exact_faces == len(true.faces())
    assert model.solid.is_valid
    assert model.solid.volume == pytest.approx(true.volume, rel=1e-3)
    assert model.report.volume == pytest.approx(model.solid.volume, rel=1e-9)
    assert cylinder_radii(model.solid) == pytest.approx([5, 6, 8], abs=0.01)
    assert tuple(model.solid.center()) == pytest.approx(tuple(true.center()), abs=0.05)


def test_relations_are_exact(model: CadModel) -> None:
    foot, wall = (model.primitives[bore(model, r)] for r in (5.0, 8.0))
    assert abs(foot.axis @ wall.axis) < 1e-9
    assert any(constraint.kind == "perpendicular" for constraint in model.report.constraints)


def test_same_scan_same_bytes(model: CadModel, tmp_path: Path) -> None:
    again = sed2cad.reconstruct(BRACKET)
    model.export_step(tmp_path / "a.step")
    again.export_step(tmp_path / "b.step")
    a, b = ((tmp_path / name).read_text().split("DATA;")[1] for name in ("a.step", "b.step"))
    assert a == b


def test_variant(model: CadModel) -> None:
    name = bore(model, 5.0)
    variant = model.vary(**{name: {"radius": 5.5}})
    assert variant.report.closed and variant.solid.is_valid
    assert cylinder_radii(variant.solid) == pytest.approx([5.5, 6, 8], abs=0.01)
    removed = np.pi * (5.5**2 - 5.0**2) * 8
    assert model.solid.volume - variant.solid.volume == pytest.approx(removed, rel=0.01)


def test_variant_refuses(model: CadModel) -> None:
    name = bore(model, 5.0)
    with pytest.raises(UsageError, match="no primitive 'cylinder_9'"):
        model.vary(cylinder_9={"radius": 1.0})
    with pytest.raises(UsageError, match="no parameter diameter"):
        model.vary(**{name: {"diameter": 1.0}})
    with pytest.raises(UsageError, match="positive"):
        model.vary(**{name: {"radius": -1.0}})
    with pytest.raises(AssemblyError):
        model.vary(**{name: {"radius": 60.0}})


def test_saved_model_is_the_same(model: CadModel, tmp_path: Path) -> None:
    model.save(tmp_path / "part.json")
    loaded = CadModel.load(tmp_path / "part.json")
    assert loaded.names == model.names and loaded.face_names == model.face_names
    assert loaded.solid.volume == model.solid.volume
    assert loaded.report == model.report
    name = bore(loaded, 8.0)
    variant = loaded.vary(**{name: {"radius": 8.8}})
    assert cylinder_radii(variant.solid) == pytest.approx([5, 6, 8.8], abs=0.01)


@pytest.mark.parametrize("text", ["", "{}", '{"format": "sed2cad-model", "version": 1}', "not json"])
def test_other_files_are_no_model(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(UsageError, match=r"x\.json"):
        CadModel.load(tmp_path / "x.json")


def test_script_makes_part_and_variant(model: CadModel, tmp_path: Path) -> None:
    from build123d import import_step

    model.save(tmp_path / "part.json")
    script = tmp_path / "part.py"
    model.write_script(script, tmp_path / "part.json")
    text = script.read_text()
    name = f"{bore(model, 5.0)}_radius"
    old = next(line for line in text.splitlines() if line.startswith(f"{name} ="))
    script.write_text(text.replace(old, f"{name} = 5.5"))
    subprocess.run([sys.executable, str(script)], check=True, cwd=tmp_path)
    assert cylinder_radii(import_step(str(tmp_path / "part.step"))) == pytest.approx([5.5, 6, 8], abs=0.01)


def test_faces_are_named(model: CadModel, tmp_path: Path) -> None:
    model.export_step(tmp_path / "part.step")
    text = (tmp_path / "part.step").read_text()
    for name in model.names:
        assert f"'{name}'" in text


def test_no_half_file_and_no_litter(model: CadModel, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        model.export_step(tmp_path / "missing" / "part.step")
    with pytest.raises(AssemblyError, match="could not be written as STEP"):
        replace(model, brep=b"no solid").export_step(tmp_path / "part.step")
    assert not any(tmp_path.iterdir())
    model.export_step(tmp_path / "part.step")
    assert [path.name for path in tmp_path.iterdir()] == ["part.step"]


def test_the_kernel_is_loaded_in_its_own_process_only() -> None:
    code = "import sys, sed2cad.pipeline; print(*{name.partition('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "sed2cad" in loaded and not {"OCP", "build123d", "cadquery"} & set(loaded)


def test_the_tolerance_makes_a_lumpy_box_a_box() -> None:
    points, normals, _ = box((100.0, 80.0, 50.0), 8000)
    waves = np.sin(points @ np.array([[0.20, 0.11, 0.05], [0.07, 0.23, 0.13]]).T)
    lumpy = points + 0.4 * waves.sum(axis=1)[:, None] * normals
    model = sed2cad.reconstruct(RawScan(lumpy, normals, name="lumpy"), sed2cad.Settings(tolerance=2.0))
    assert sorted(model.face_names) == [f"plane_{n}" for n in range(1, 7)]
    assert model.report.volume == pytest.approx(4e5, rel=0.02)


@pytest.mark.parametrize("fails", [False, True])
def test_small_faces_that_make_no_solid_are_left_out_and_that_is_told(
    monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    points, normals, _ = box((0.7, 0.5, 0.3), 3000)

    def segmenter(scan: Scan, settings: Settings, clock: Clock) -> Segmentation:
        side = np.argmax(scan.normals @ np.vstack([np.eye(3), -np.eye(3)]).T, axis=1)
        planes = [Patch(own := np.flatnonzero(side == k), "plane", np.ones(len(own), bool)) for k in range(6)]
        return Segmentation(planes, scan, list(planes))

    if fails:
        monkeypatch.setattr(Climb, "first", lambda climb: climb.failures.append("exact: crossed"))
    model = reconstruct_from(segmenter, RawScan(points, normals, name="box"), Settings())
    assert model.report.closed and model.report.exact_faces == model.report.faces == 6
    assert any("small faces" in note for note in model.report.warnings) == fails
    assert model.report.reason == ("exact: crossed" if fails else "")
