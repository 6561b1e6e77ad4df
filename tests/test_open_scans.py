"""Scans that do not show all of a part, from the file to the STEP file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import sed2cad
from sed2cad import assembly
from sed2cad.assembly import Assembly
from sed2cad.brep.kernel import faces, is_closed, is_valid
from sed2cad.brep.opening import without_faces
from sed2cad.brep.step import read_step
from sed2cad.cli import app
from sed2cad.model import CadModel
from sed2cad.scan.raw import RawScan
from tests.brep.made import part, result, shape
from tests.parts import box_points, bracket, sample_scan, write_ply


def on_a_table(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals without the face that the part stands on."""
    shown = (points[:, 2] > points[:, 2].min() + 1e-3) | (normals[:, 2] > -0.9)
    return points[shown], normals[shown]


@pytest.fixture(scope="module")
def open_bracket() -> CadModel:
    return sed2cad.reconstruct(RawScan(*on_a_table(*sample_scan(bracket(), 10_000)), name="bracket"))


def test_the_shell_is_open_where_the_scan_ends(open_bracket: CadModel, tmp_path: Path) -> None:
    report = open_bracket.report
    assert not report.closed and report.faces == report.exact_faces == 10
    assert np.isnan(report.volume)
    outer, bore = sorted(report.boundaries, key=lambda boundary: -boundary.length)
    assert outer.length == pytest.approx(200, rel=0.02) and bore.length == pytest.approx(10 * np.pi, rel=0.02)
    assert outer.centre == pytest.approx((30, 20, 0), abs=0.1) and len(outer.faces) == 4
    assert bore.faces[0].startswith("cylinder")
    assert report.deviation.rms < 1e-3  # of the points that were measured
    assert any("the shell is open where it ends" in warning for warning in report.warnings)
    open_bracket.export_step(tmp_path / "open.step")
    back = read_step(tmp_path / "open.step")
    assert len(faces(back)) == 10 and is_valid(back) and not is_closed(back)
    assert type(open_bracket.solid).__name__ == "Shell"


def test_an_open_model_is_saved_and_varied(open_bracket: CadModel, tmp_path: Path) -> None:
    open_bracket.save(tmp_path / "open.json")
    model = CadModel.load(tmp_path / "open.json")
    assert model.open_at == open_bracket.open_at and model.report.boundaries == open_bracket.report.boundaries
    (name,) = [name for name in model.report.boundaries[1].faces if name.startswith("cylinder")]
    wider = model.vary(**{name: {"radius": 5.5}})
    assert len(wider.face_names) == 10 and not wider.report.closed
    assert wider.primitives[name].parameters()["radius"] == pytest.approx(5.5)


def test_the_command_caps_or_says_what_is_open(tmp_path: Path) -> None:
    write_ply(tmp_path / "box.ply", *on_a_table(*box_points(4000)))
    step = tmp_path / "box.step"
    words = [str(tmp_path / "box.ply"), "--step", str(step)]
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 4 and "--cap" in told.stderr and "  open around (" in told.stdout
    assert "open shell, 5 faces" in told.stdout and len(faces(read_step(step))) == 5
    assert CliRunner().invoke(app, [*words, "--allow-open"]).exit_code == 0
    told = CliRunner().invoke(app, [*words, "--cap"])
    assert told.exit_code == 0 and "closed solid, 6 faces" in told.stdout
    assert "1 flat cap was added" in told.stderr


def seen_from_above(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """The top of a box on a table, 40 x 40 and 30 high, and the table on two sides of it."""
    rng = np.random.default_rng(0)
    plates = (((0, 0, 30), (40, 40), 0.5), ((-40, 0, 0), (30, 40), 0.3), ((50, 0, 0), (20, 40), 0.2))
    points = [
        low + rng.random((int(share * count), 3)) * [*size, 0.0] for low, size, share in plates
    ]
    return np.vstack(points), np.tile([0.0, 0.0, 1.0], (count, 1))


def test_of_a_scan_from_one_side_the_faces_are_written_that_it_shows(tmp_path: Path) -> None:
    write_ply(tmp_path / "above.ply", *seen_from_above())
    step, model = tmp_path / "above.step", tmp_path / "above.json"
    words = [str(tmp_path / "above.ply"), "--step", str(step), "--report", str(model)]
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 4 and "open shell, 3 faces, all exact" in told.stdout
    back = read_step(step)
    assert len(faces(back)) == 3 and is_valid(back) and not is_closed(back)
    made = CadModel.load(model)
    assert [len(boundary.faces) for boundary in made.report.boundaries] == [1, 1, 1]
    assert [boundary.length for boundary in made.report.boundaries] == pytest.approx([160, 140, 120], rel=0.08)
    assert any("the shell is open where it ends" in warning for warning in made.report.warnings)
    (top,) = (name for name, plane in made.primitives.items() if plane.kind == "plane" and plane.offset > 15)
    higher = made.vary(**{top: {"offset": 35.0}})
    assert len(higher.face_names) == 3 and not higher.report.closed
    assert max(face.center().Z for face in higher.solid.faces()) == pytest.approx(35, abs=1e-3)


def test_a_face_of_unknown_origin_stays() -> None:
    """A repair may lose track of a face; the last region, a cap, is not its own."""
    made, given = result("box"), part("box")
    lost = tuple(replace(face, region=-1, primitive=-1) if k == 0 else face for k, face in enumerate(made.faces))
    cap = len(given.topology.regions) - 1
    (number,) = [k for k, face in enumerate(made.faces) if face.region == cap]
    assert number != 0
    closed = Assembly(given.fitted, given.topology, replace(made, faces=lost), tuple("abcdef"), "exact", ())
    opened = assembly._opened(closed, [given.topology.regions[cap].primitive])
    assert len(opened.solid.faces) == 5 and opened.solid.faces[0].region == -1
    assert opened.face_names == tuple(name for k, name in enumerate("abcdef") if k != number)


def test_a_solid_loses_the_faces_that_are_named() -> None:
    solid = shape("box")
    opened = without_faces(solid, {2})
    assert len(faces(opened)) == 5 and is_valid(opened) and not is_closed(opened)
    whole = without_faces(solid, set())
    assert len(faces(whole)) == 6 and is_closed(whole)
