"""The measurement of freeform fits on parts: exact points, fair to a good fit, hard on a biased one."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from sed2cad.cli import app
from sed2cad.errors import UsageError
from sed2cad.evaluation import fitting as benchmark
from sed2cad.evaluation.fitting import FittingSettings
from sed2cad.evaluation.spline_patches import score_spline_patches, spline_patches_text, true_splines
from sed2cad.fitting import fit
from sed2cad.training.cad import label_part
from sed2cad.training.dataset import parts_in
from tests.training.cadparts import wavy_bar, write


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A bar with a wavy side, packed and as a CAD file."""
    folder = tmp_path_factory.mktemp("bar")
    cad = write(wavy_bar(), folder / "bar.brep")
    label_part(cad).save(folder / "bar.npz")
    return folder / "bar.npz", cad


def test_points_of_a_cad_file_are_exact_and_those_of_a_packed_part_nearly(files):
    packed, exact = (next(true_splines(file, 500)) for file in files)
    assert len(list(true_splines(files[0], 10))) == 1
    assert exact.size == pytest.approx(1, abs=0.01) and packed.patch == exact.patch
    assert np.abs(exact.normals[:, 2]).max() < 1e-9
    assert exact.normals[:, 1].mean() > 0.5  # outward
    found, _, _ = fit("bspline", exact.points, exact.normals, 0.0)
    assert np.sqrt(np.mean(found.distance(packed.probes) ** 2)) < 1e-4


def test_a_fit_is_scored_by_points_that_it_has_not_seen(files):
    def raised(kind, points, normals, noise):
        found, rms, covariance = fit(kind, points, normals, noise)
        return replace(found, origin=found.origin + 1e-3 * found.frame[2]), rms, covariance

    fair, bent = (score_spline_patches(files, 800, fitter) for fitter in (fit, raised))
    assert [row.part for row in fair] == ["bar", "bar"]
    assert max(row.rms for row in fair) < 1e-4
    assert all(5e-4 < row.rms <= row.largest < 2e-3 for row in bent)
    assert "100.0 %" in spline_patches_text(fair) and "0.0 %" in spline_patches_text(bent)
    none = score_spline_patches(files[:1], 800, lambda *given: None)
    assert none[0].rms == np.inf and none[0].base == "none"


def test_packed_parts_come_before_cad_files(files, tmp_path):
    assert parts_in(files[0].parent, cad=True) == [files[0]]
    with pytest.raises(UsageError):
        parts_in(tmp_path)
    with pytest.raises(UsageError):
        parts_in(tmp_path / "no")


def test_the_command_shows_the_patches_of_parts(files, tmp_path, monkeypatch):
    small = FittingSettings(1, 1, (1e-3,), (100,), (90.0,), (0.0,), ())
    monkeypatch.setattr(benchmark, "FittingSettings", lambda seeds, workers: small)
    monkeypatch.setattr(benchmark, "seconds_of_a_part", lambda: 1.0)
    words = ["evaluate", "fitting", str(files[0].parent), "-q", "--json", str(tmp_path / "fitting.json")]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.stderr
    lines = result.stdout.splitlines()
    assert any(line.startswith("spline patches ") for line in lines)
    assert any(line.startswith("worst patches ") for line in lines)
    held = [line for line in lines if line.startswith("B-spline patches of parts without noise")]
    assert len(held) == 2 and all(line.endswith("held") for line in held)
    content = json.loads((tmp_path / "fitting.json").read_text())
    assert [row["part"] for row in content["spline_patches"]] == ["bar"]
    refused = CliRunner().invoke(app, [*words[:2], str(tmp_path / "no")])
    assert refused.exit_code == 2 and "there is no such folder" in refused.stderr
