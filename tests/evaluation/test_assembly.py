"""Solids are scored right, and a run survives what its parts do."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sed2cad.brep.worker import Failure, run_alone
from sed2cad.cli import app
from sed2cad.errors import UsageError
from sed2cad.evaluation import assembly, solid_scores
from sed2cad.evaluation.assembly import AssemblySettings, PartRow, cad_files, score_part
from sed2cad.evaluation.assembly_tables import assembly_text
from sed2cad.evaluation.made_scans import KINDS, MadeScan, make_scan, patches_of
from sed2cad.evaluation.solid_scores import ScoreJob, SolidScore, score_solid
from sed2cad.scan.prepare import prepare
from tests.brep import jobs
from tests.training.cadparts import write

SIZE = (20, 16, 10)
EXACT = SolidScore(True, 1, 1, 0.0, 1e-3, 1e-4, {"Plane": 6}, {"Plane": 6}, 1.0, 1.0, True)


def holed(radius: float = 5.0) -> Any:
    """A box of SIZE with a bore along z."""
    from build123d import Box, Cylinder

    return Box(*SIZE) - Cylinder(radius, 20)


def facets(shape: Any, path: Path) -> Any:
    """The same of triangles."""
    from build123d import Mesher, export_stl

    export_stl(shape, path, 0.05, 0.2)
    return Mesher().read(path)[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("cad")
    write(holed(), found / "holed.brep")
    return found


@pytest.fixture
def score(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., SolidScore]:
    """The score of a shape against the box with a bore."""
    monkeypatch.setattr(solid_scores, "SAMPLES", 4_000)

    def against(shape: Any, merge: bool = True) -> SolidScore:
        return score_solid(ScoreJob(write(shape, tmp_path / "written.step"), folder / "holed.brep", merge))

    return against


@pytest.mark.parametrize("merge", [True, False])
def test_a_part_is_exactly_itself(score: Callable[..., SolidScore], merge: bool) -> None:
    found = score(holed(), merge)
    assert found.closed and found.solved and found.exact and found.merged == merge
    assert found.faces == {"Plane": 6, "Cylinder": 1}
    assert abs(found.volume_error) < 1e-9 and found.hausdorff < 1e-3 and found.analytic == 1.0


def test_a_missing_bore_is_seen_in_the_volume(score: Callable[..., SolidScore]) -> None:
    from build123d import Box

    found = score(Box(*SIZE))
    assert found.closed and not found.solved
    assert found.faults == ("volume off", "Hausdorff off")
    assert found.volume_error == pytest.approx(np.prod(SIZE) / (np.prod(SIZE) - np.pi * 250) - 1, rel=1e-6)


def test_facets_do_not_pass(score: Callable[..., SolidScore], tmp_path: Path) -> None:
    found = score(facets(holed(), tmp_path / "facets.stl"))
    assert found.closed and not found.solved
    assert found.faults == ("too many faces",)


def test_a_shift_is_a_distance(score: Callable[..., SolidScore]) -> None:
    from build123d import Pos

    found = score(Pos(1, 0, 0) * holed())
    assert found.closed and found.faults == ("Hausdorff off",)
    radius = np.linalg.norm(SIZE) / 2
    assert found.hausdorff == pytest.approx(1 / radius, rel=1e-2)
    assert found.off_rms < found.hausdorff


def test_two_bodies_and_an_open_shell(score: Callable[..., SolidScore]) -> None:
    from build123d import Box, Compound, Pos, Shell

    assert "wrong number of solids" in score(Compound([holed(), Pos(40, 0, 0) * Box(1, 1, 1)])).faults
    assert score(Shell(holed().faces()[1:])).faults == ("not closed",)


def test_faces_on_one_surface_count_once(score: Callable[..., SolidScore]) -> None:
    from build123d import Keep, split
    from build123d.topology import SkipClean

    one, other = split(holed(), keep=Keep.BOTH).solids()
    with SkipClean():
        glued = one.fuse(other)
    assert score(glued).exact
    assert score(glued, merge=False).differences == ("Cylinder +1", "Plane +4")


def test_a_chamfer_is_another_type(score: Callable[..., SolidScore]) -> None:
    from build123d import Axis, GeomType, chamfer

    rim = holed().edges().filter_by(GeomType.CIRCLE).sort_by(Axis.Z)[-1]
    found = score(chamfer(rim, 0.2))
    assert found.solved and not found.exact and found.differences == ("Cone +1",)


def test_what_is_no_file_is_not_closed(folder: Path, tmp_path: Path) -> None:
    found = score_solid(ScoreJob(tmp_path / "nothing.step", folder / "holed.brep"))
    assert found.faults == ("not closed",) and "cannot read" in found.error


@pytest.mark.parametrize("kind", KINDS)
def test_scans_and_their_true_patches(folder: Path, kind: str) -> None:
    made = make_scan(folder / "holed.brep", kind)
    radius = np.linalg.norm(SIZE) / 2
    assert np.linalg.norm(made.raw.points, axis=1).max() < (1.1 * np.sqrt(3) if kind == "dense" else 1.02) * radius
    assert (made.raw.mesh is not None) == (kind == "mesh")
    if kind != "mesh":
        assert kind == "table" or len(made.raw.points) == (200_000 if kind == "dense" else 10_000)
        off = np.abs(np.abs(made.raw.points[:, 2]) - SIZE[2] / 2)
        noise = {"clean": 1e-5, "table": 1e-5, "noisy": 0.01 * radius, "dense": 4e-3 * radius}[kind]
        assert np.sort(off)[1_000] < noise
    made = smaller(made)
    scan = prepare(made.raw, 0)
    found = patches_of(made, scan)
    assert sorted(patch.kind for patch in found) == ["cylinder", *["plane"] * (5 if kind == "table" else 6)]
    bore = next(patch for patch in found if patch.kind == "cylinder")
    away = np.linalg.norm(scan.frame.to_world(scan.points[bore.indices])[:, :2], axis=1)
    assert np.abs(away - 5).max() < 0.2 and bore.interior.mean() > 0.8
    assert len(scan.points) - 200 <= sum(len(patch.indices) for patch in found) <= len(scan.points)


def test_a_part_stands_on_its_largest_flat_face(folder: Path, tmp_path: Path) -> None:
    from build123d import Sphere

    shown = make_scan(folder / "holed.brep", "table").raw
    assert shown.normals is not None
    up = shown.normals.mean(axis=0)  # zero, were it closed
    assert np.abs(up)[:2].max() < 0.02 < abs(up[2]) and (shown.normals @ up / abs(up[2]) > -0.1).all()
    write(Sphere(10), tmp_path / "ball.step")
    with pytest.raises(ValueError, match="no flat face"):
        make_scan(tmp_path / "ball.step", "table")


def smaller(made: MadeScan) -> MadeScan:
    """Every 20th point of a dense scan, all outliers."""
    if made.cloud is None or len(made.raw.points) < 20_000:
        return made
    count = len(made.cloud.points)
    cloud = replace(made.cloud, **{name: values[::20] for name, values in vars(made.cloud).items()})
    points = np.vstack([made.raw.points[:count:20], made.raw.points[count:]])
    return replace(made, raw=replace(made.raw, points=points), cloud=cloud)


def here(job: Callable[[Any], Any], payload: Any, seconds: float) -> Any:
    """run_alone without a process."""
    return job(payload)


def test_a_crash_is_a_row(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def instead(job: Callable[[Any], Any], payload: Any, seconds: float) -> Any:
        return run_alone(jobs.crash, None, seconds) if job is assembly.reconstruct_part else job(payload)

    monkeypatch.setattr(assembly, "run_alone", instead)
    row = score_part(folder / "holed.brep", "holed", AssemblySettings("true"))
    assert (row.part, row.failure, row.causes) == ("holed", "crashed", ("crashed",))
    assert not (row.closed or row.solved or row.exact)
    assert "   1  crashed: holed" in assembly_text([row])


def test_a_crash_while_faces_are_merged_is_not_ours(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def instead(job: Callable[[Any], Any], payload: Any, seconds: float) -> Any:
        return Failure("crash", "") if payload.merge else EXACT

    monkeypatch.setattr(assembly, "run_alone", instead)
    assert assembly.scored(folder, folder) == EXACT


def test_true_labels_give_an_exact_part(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assembly, "run_alone", here)
    words = ("assembly", folder, "--labels", "true", "--json", tmp_path / "rows.json")
    result = CliRunner().invoke(app, ["evaluate", *map(str, words)])
    assert result.exit_code == 0, result.stderr
    assert "assembly  1 of 1: holed  exact" in result.stderr
    assert result.stdout.splitlines()[1].split()[:7] == ["1", "100", "%", "100", "%", "100", "%"]
    assert result.stdout.splitlines()[-1].split() == ["1", "exact"]
    written = json.loads((tmp_path / "rows.json").read_text())
    assert written["settings"]["labels"] == "true"
    (row,) = written["parts"]
    assert row["exact"] and row["causes"] == [] and row["score"]["faces"] == {"Plane": 6, "Cylinder": 1}
    assert row["peak_mb"] > 50 and row["score"]["hausdorff"] < 1e-3


def test_causes_are_counted_with_their_parts() -> None:
    rows = [
        PartRow("a", score=EXACT, seconds=1.0, rung="exact"),
        PartRow("b", score=replace(EXACT, faces={"Plane": 5, "Cone": 1}, merged=False), seconds=2.0, rung="mended"),
        PartRow("c", score=replace(EXACT, volume_error=0.1, hausdorff=0.2), seconds=9.0, rung="facets"),
        PartRow("d", "timeout", "took longer than 9 s", 9.0),
    ]
    text = assembly_text(rows).splitlines()
    assert text[1].split()[:7] == ["4", "75", "%", "50", "%", "25", "%"]
    causes = ("Hausdorff off: c", "timeout: d", "volume off: c", "Cone +1: b", "Plane -1: b")
    assert all(f"   1  {cause}" in text for cause in causes)
    assert "d: took longer than 9 s" in text and any("without merging" in line and line.endswith(" b") for line in text)


def test_usage(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown word 'guess'"):
        AssemblySettings("guess")
    with pytest.raises(UsageError, match="unknown word 'wet'"):
        AssemblySettings("true", "wet")
    with pytest.raises(UsageError, match=r"no \.step"):
        cad_files(tmp_path, None)
    for name in "abcde":
        (tmp_path / f"{name}.step").touch()
    assert [file.stem for file in cad_files(tmp_path, 3)] == ["a", "c", "e"]
