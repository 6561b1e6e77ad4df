"""The command line: what goes wrong gets one sentence and its exit code, what goes right its files."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sed2cad import __version__
from sed2cad.cli import app, parse_changes
from sed2cad.errors import Sed2cadError, UsageError, WeightsError
from sed2cad.model import CadModel
from tests.parts import DATA, box_points, write_ply

BRACKET = DATA / "bracket.ply"


def run(*words: str | Path) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.stdout, result.stderr


def bad_scans(folder: Path) -> dict[str, tuple[Path, int, str]]:
    """The bad inputs: file, exit code, sentence."""
    points, normals = box_points(1000)
    paths = {
        name: folder / f"{name}.ply"
        for name in ("empty", "text", "nan", "few", "plane", "line", "copies", "cut", "folder", "missing")
    }
    paths["empty"].touch()
    paths["text"].write_text("Dear colleague,\nplease find attached ...\n")
    write_ply(paths["nan"], np.where(np.arange(1000)[:, None] % 10 == 0, np.nan, points))
    write_ply(paths["few"], points[:49])
    write_ply(paths["plane"], points * [1, 1, 0])
    write_ply(paths["line"], points * [1, 0, 0])
    write_ply(paths["copies"], points[np.arange(1000) % 20])
    write_ply(paths["cut"], points, normals)
    paths["cut"].write_bytes(paths["cut"].read_bytes()[:-1000])
    paths["folder"].mkdir()
    paths["unknown"] = folder / "scan.docx"
    paths["unknown"].write_text("x")
    sentences = {
        "empty": "empty.ply: the file is empty; export or copy the scan again",
        "text": "text.ply: this is not a PLY file (it does not begin with 'ply'); export it again",
        "nan": "nan.ply: 100 of 1000 points are NaN or infinite; export it without them",
        "few": "few.ply: only 49 points, a scan needs 50; scan the part denser",
        "plane": "plane.ply: all points lie on one plane; scan the part from all sides",
        "line": "line.ply: all points lie on one line; scan the part from all sides",
        "copies": "copies.ply: only 20 of its 1000 points are distinct, a scan needs 50; export it again",
        "cut": "cut.ply: the file is cut short, 1000 bytes of its 1000 vertex rows are missing; "
        "copy or export it again",
        "folder": f"{paths['folder']}: this is a folder; give one scan file",
        "missing": f"{paths['missing']}: there is no such file; check the name",
        "unknown": "scan.docx: unknown file type '.docx'; sed2cad reads .ply .stl .obj",
    }
    return {name: (path, 3, sentences[name]) for name, path in paths.items()}


@pytest.mark.parametrize(
    "case", ["empty", "text", "nan", "few", "plane", "line", "copies", "cut", "folder", "missing", "unknown"]
)
def test_bad_scans(tmp_path: Path, case: str) -> None:
    path, code, sentence = bad_scans(tmp_path)[case]
    step = tmp_path / "out.step"
    step.write_text("an older result")
    got, out, err = run(path, "--step", step, "-q")
    assert (got, out) == (code, "")
    assert err.startswith(f"sed2cad: {sentence}") and err.count("\n") == 1
    assert step.read_text() == "an older result"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--step", "{tmp}"), "--step writes STEP files; give it a name that ends in .step"),
        (("--step", "{tmp}/dir.step"), "this is a folder; give --step a file name"),
        (("--step", "{tmp}/no/out.step"), "there is no folder {tmp}/no; make it or choose another name"),
        (("--step", "/proc/out.step"), "cannot be written"),
        (("--report", "{tmp}/no/out.json"), "there is no folder {tmp}/no; make it or choose another name"),
        (("--report", str(BRACKET)), "--report would overwrite the input; choose another name"),
        (("--report", "{tmp}/a", "--script", "{tmp}/a"), "--script would overwrite the output of --report"),
        (("--unit", "ft"), "unknown unit 'ft': it must be one of mm, cm, m, in"),
        (("--tolerance", "-1"), "the tolerance is -1.0: it must be a length above 0"),
        (("--round", "0"), "the step of rounding is 0.0: it must be a length above 0"),
        (("--round", "1", "--no-regularize"), "raw fits cannot be rounded: choose --round or --no-regularize"),
        (("--seed", "-1"), "the seed is -1: it must be between 0 and 4294967295"),
    ],
)
def test_usage(tmp_path: Path, words: tuple[str, ...], sentence: str) -> None:
    (tmp_path / "dir.step").mkdir()
    words = tuple(word.format(tmp=tmp_path) for word in words)
    default = () if "--step" in words else ("--step", tmp_path / "out.step")
    code, out, err = run(BRACKET, *default, *words)
    assert (code, out) == (2, "")
    assert sentence.format(tmp=tmp_path) in err and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["dir.step"]


def test_unknown_option_and_no_words() -> None:
    assert run(BRACKET, "--bogus")[0] == 2
    assert run()[0] == 2


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (WeightsError("w.safetensors: damaged; install sed2cad again"), 5, "w.safetensors: damaged"),
        (KeyError("radius"), 1, "this is a bug, please report it with the scan and the output of -v (Key"),
        (KeyboardInterrupt(), 130, "stopped by the user"),
    ],
)
def test_other_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, sentence: str
) -> None:
    def broken(*args: object) -> None:
        raise error

    monkeypatch.setattr("sed2cad.pipeline.reconstruct", broken)
    got, _, err = run(BRACKET, "--step", tmp_path / "a.step")
    assert got == code and err.startswith(f"sed2cad: {sentence}") and err.count("\n") == 1
    traced = run(BRACKET, "--step", tmp_path / "a.step", "-v")[2]
    assert ("Traceback" in traced) == (code != 130)


def test_every_error_has_an_exit_code() -> None:
    codes = {error.__name__: error.exit_code for error in Sed2cadError.__subclasses__()}
    assert codes == {"UsageError": 2, "ScanError": 3, "AssemblyError": 4, "WeightsError": 5}


def test_changes() -> None:
    changes = parse_changes(["cylinder_3.radius=6", "cylinder_3.axis=0,0,1", "plane_1.offset=-2e1"])
    assert changes == {"cylinder_3": {"radius": 6.0, "axis": (0.0, 0.0, 1.0)}, "plane_1": {"offset": -20.0}}
    for wrong in ("cylinder_3", "cylinder_3.radius", "cylinder_3=6", ".radius=6", "cylinder_3.radius=six"):
        with pytest.raises(UsageError, match=r"write it like cylinder_3\.radius=6"):
            parse_changes([wrong])


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["vary", "--help"]])
def test_answers_at_once(words: list[str]) -> None:
    """Nothing that is slow to import is: the CAD kernel takes seconds."""
    command = [sys.executable, "-X", "importtime", "-m", "sed2cad", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    imported = {line.rpartition("|")[2].strip().partition(".")[0] for line in done.stderr.splitlines()}
    assert "typer" in imported
    assert not imported & {"numpy", "scipy", "torch", "OCP", "build123d", "trimesh", "gpytoolbox", "jinja2"}
    assert "--version" not in words or done.stdout == f"sed2cad {__version__}\n"


def test_the_main_job_does_without_torch() -> None:
    code = "import sys, sed2cad.pipeline; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_training_without_torch_says_what_to_install(tmp_path: Path) -> None:
    code = "import sys; sys.modules['torch'] = None; from sed2cad.cli import main; main()"
    command = [sys.executable, "-c", code, "train", str(tmp_path), "-o", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "sed2cad: this command trains networks and needs torch: pip install 'sed2cad[train]'\n"


def test_main_job_and_a_variant(tmp_path: Path) -> None:
    step, report, script = tmp_path / "b.step", tmp_path / "b.json", tmp_path / "b.py"
    code, out, err = run(BRACKET, "--step", step, "--report", report, "--script", script)
    assert code == 0, err
    assert "b.step: closed solid, 11 faces, all exact" in out
    assert [line.split()[0] for line in err.splitlines()][:4] == ["scan", "network", "segment", "fit"]
    assert step.read_bytes().startswith(b"ISO-10303-21") and script.stat().st_size
    radii = {name: p.get("radius") for name, p in _parameters(report).items() if "radius" in p}
    bore = next(name for name, radius in radii.items() if abs(radius - 5) < 0.01)
    variant = tmp_path / "v.json"
    change = ("--set", f"{bore}.radius=5.5")
    code, out, err = run("vary", report, *change, "--step", tmp_path / "v.step", "--report", variant)
    assert code == 0, err
    assert "v.step: closed solid, 11 faces" in out
    assert _parameters(variant)[bore]["radius"] == pytest.approx(5.5)


def test_rounding_is_listed_and_kept_in_the_model(tmp_path: Path) -> None:
    step, report = tmp_path / "b.step", tmp_path / "b.json"
    code, out, err = run(BRACKET, "--step", step, "--report", report, "--round", "0.1", "-v")
    assert code == 0, err
    assert re.search(r"^  perpendicular: plane_\d, plane_\d \(was off by \S+ degrees\)$", out, re.MULTILINE)
    assert re.search(r"^  rounded: cylinder_\d \(radius \S+ to 5\)$", out, re.MULTILINE)
    radii = sorted(p["radius"] for p in _parameters(report).values() if "radius" in p)
    assert radii == pytest.approx([5, 6, 8], abs=1e-9)
    listed = json.loads(report.read_text())["report"]["constraints"]
    (told,) = (c for c in listed if c["measure"] == "radius" and abs(c["after"] - 5) < 1e-9)
    assert told["kind"] == "rounded" and _parameters(report)[told["faces"][0]]["radius"] == pytest.approx(5)
    assert abs(told["before"] - 5) == pytest.approx(told["off"], rel=1e-6) and 0 < told["off"] < 0.01
    model = CadModel.load(report)
    assert out.splitlines()[-len(listed) :] == [f"  {constraint}" for constraint in model.report.constraints]
    (bore,) = told["faces"]
    variant = model.vary(**{bore: {"radius": 5.5}})
    assert variant.report.closed
    assert variant.report.constraints == tuple(c for c in model.report.constraints if bore not in c.faces)


def test_raw_fits(tmp_path: Path) -> None:
    report = tmp_path / "b.json"
    code, out, err = run(BRACKET, "--step", tmp_path / "b.step", "--report", report, "--no-regularize")
    assert code == 0, err
    assert "b.step: closed solid, 11 faces, all exact (exact, not regularised)" in out and "warning" not in err
    assert json.loads(report.read_text())["report"]["constraints"] == []
    radii = sorted(p["radius"] for p in _parameters(report).values() if "radius" in p)
    assert radii == pytest.approx([5, 6, 8], abs=0.01) and radii != pytest.approx([5, 6, 8], abs=1e-9)


def _parameters(path: Path) -> dict[str, dict[str, float]]:
    primitives = json.loads(path.read_text())["primitives"]
    return {name: entry["parameters"] for name, entry in primitives.items()}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("vary", "none.json", "--set", "a.b=1", "--step", "a.step"), "none.json: cannot be read"),
        (("dataset", "nowhere", "-o", "data"), "nowhere: there is no such folder"),
        (("train", "nowhere", "-o", "run"), "nowhere: there is no such folder"),
        (("evaluate", "segmentation", "."), ".: there are no packed parts in it"),
    ],
)
def test_commands_refuse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run(*words)
    assert code == 2 and err.startswith(f"sed2cad: {sentence}") and err.count("\n") == 1
