"""SplineNet learns, and goes on where it stopped."""

import json

import numpy as np
import pytest
import torch

from sed2cad.network.spline_frame import CONTROLS, spline_basis
from sed2cad.training.__main__ import main
from sed2cad.training.cad import label_part
from sed2cad.training.made_sheets import made_sheet
from sed2cad.training.splinenet import HALF, WEIGHTS, SplineSettings, _evaluated, _ways, train_splinenet
from tests.training.cadparts import wavy_bar, write


@pytest.mark.parametrize("closed", [False, True])
def test_normals_of_made_sheets_are_across_them(closed):
    sheet = made_sheet(np.random.default_rng(3), 3_000, closed)
    assert sheet.uv.min() >= 0 and sheet.uv.max() <= 1
    apart = np.linalg.norm(sheet.uv[:, None, :] - sheet.uv[None, :50], axis=2)
    near, of = np.nonzero((apart > 0) & (apart < 0.02))
    step = sheet.points[near] - sheet.points[of]
    lean = np.abs(np.einsum("ij,ij->i", step, sheet.normals[of])) / np.linalg.norm(step, axis=1)
    assert np.median(lean) < 0.05


@pytest.mark.parametrize("closed", [False, True])
def test_all_ways_are_the_same_surface(closed):
    net = torch.randn(1, CONTROLS, CONTROLS, 3, generator=torch.Generator().manual_seed(0))
    at = np.arange(0, 1, 1 / CONTROLS) if closed else np.linspace(0, 1, 13)
    u, v = np.meshgrid(at, np.linspace(0, 1, 13), indexing="ij")
    basis_u, basis_v = (torch.from_numpy(spline_basis(x.ravel(), c))[None] for x, c in ((u, closed), (v, False)))
    clouds = _evaluated(_ways(net, closed), basis_u, basis_v)[:, 0]
    assert len(clouds) == (48 if closed else 8)
    for cloud in clouds:
        assert torch.cdist(cloud, clouds[0]).amin(1).max() < 1e-3


def test_it_learns_and_resumes(tmp_path):
    parts = tmp_path / "parts"
    parts.mkdir()
    label_part(write(wavy_bar(), tmp_path / "bar.brep")).save(parts / "bar.npz")
    settings = SplineSettings(batch=2, max_steps=4, log_steps=2)
    train_splinenet(settings, [parts], tmp_path / "run")
    train_splinenet(SplineSettings(batch=2, max_steps=24, log_steps=2), [parts], tmp_path / "run")
    lines = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == list(range(2, 25, 2))
    assert lines[0]["patches"] == 1
    assert np.mean([line["open"] for line in lines[-3:]]) < 0.9 * lines[0]["open"]


def test_the_command(tmp_path, capsys):
    (tmp_path / "none").mkdir()
    main(["splinenet", str(tmp_path / "none"), "-o", str(tmp_path / "run"), "--steps", "1"])
    assert (tmp_path / "run" / HALF).stat().st_size < (tmp_path / "run" / WEIGHTS).stat().st_size
