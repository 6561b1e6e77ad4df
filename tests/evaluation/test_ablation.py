import json

import pytest
import torch

from sed2cad.errors import UsageError
from sed2cad.evaluation import trial
from sed2cad.evaluation.ablation import (
    SCORES,
    AblationRun,
    AblationSettings,
    ablation_json,
    ablation_text,
    rows_of,
    run_ablation,
)
from sed2cad.network.architecture import Architecture
from sed2cad.network.sednet import SedNet
from sed2cad.network.weights import load_weights, save_weights
from tests.evaluation.clouds import box

SMALL = Architecture((8, 8, 8), 16, 16, 8, 4, 8, 1, 8, 2)
TINY = AblationSettings(
    steps=2, points=400, rows=256, batch=2, parts=4, validation_parts=1, pretrain_steps=3, architecture=SMALL
)
ROWS = [
    "full", "without two branches", "without late fusion", "without early fusion", "without lambda", "plain input",
]  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    for seed in range(5):
        box(0.5 + 0.1 * seed).save(folder / f"{seed}.npz")
    return folder


def test_rows_differ_in_one_thing_each():
    rows = rows_of(TINY)
    assert list(rows) == ROWS
    assert len(set(map(str, rows.values()))) == len(rows)
    assert rows["without lambda"].edge_weight == 1
    assert not rows["without two branches"].architecture.two_branches


def test_finished_rows_are_not_trained_again(data, tmp_path, monkeypatch):
    monkeypatch.setattr(trial, "MAX_POINTS", 1_000)  # of the training's own validation
    sentences = []
    runs = run_ablation(data, data, tmp_path / "runs", TINY, sentences.append)
    assert [run.row for run in runs] == ROWS
    assert all(0 <= getattr(run, name) <= 1 for run in runs for name in SCORES)
    assert len(sentences) == 2 * len(ROWS)
    (tmp_path / "runs" / "plain_input_0" / "scores.json").unlink()
    again = run_ablation(data, data, tmp_path / "runs", TINY, sentences.append)
    assert again[:-1] == runs[:-1]
    assert len(sentences) == 2 * len(ROWS) + 2
    steps = [json.loads(line).get("step") for line in (tmp_path / "runs/full_0/log.jsonl").read_text().splitlines()]
    assert max(steps) == 2
    with pytest.raises(UsageError, match="holds an ablation with other settings"):
        run_ablation(data, data, tmp_path / "runs", AblationSettings(steps=3), sentences.append)


def test_table_of_means_over_seeds():
    runs = [AblationRun("full", seed, 9, 0.5, 0.8, 0.6 + 0.1 * seed, 0.9, 0.7, 0.5) for seed in range(2)]
    runs.append(AblationRun("plain input", 0, 9, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0))
    lines = ablation_text(runs).splitlines()
    assert "0.650 ±0.071" in lines[1] and lines[2].split()[:5] == ["plain", "input", "1", "9", "0.400"]
    content = json.loads(ablation_json(TINY, runs))
    assert content["rows"][0]["p_miou_strict"] == pytest.approx(0.65)
    assert len(content["runs"]) == 3 and content["settings"]["steps"] == 2


def test_one_branch_gives_all_outputs():
    """No second branch and no fusion: the descriptor comes from the branch of the types."""
    network = SedNet(Architecture((8, 8, 8), 16, 16, 8, 4, 8, 1, 8, 2, two_branches=False))
    output = network.branches(torch.rand(5, 16))
    assert [tuple(part.shape) for part in output] == [(5, 6), (5, 2), (5, 4)]
    names = {name.split(".")[0] for name in network.state_dict()}
    assert not names & {"instance_branch", "early", "late"}


def test_weights_that_know_nothing_of_branches_load(tmp_path):
    """Files written before `two_branches` was a setting have two."""
    from safetensors import safe_open
    from safetensors.torch import save_file

    save_weights(SedNet(SMALL), tmp_path / "new.safetensors")
    with safe_open(tmp_path / "new.safetensors", "pt") as file:
        metadata, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}
    shape = json.loads(metadata["architecture"])
    del shape["two_branches"]
    save_file(tensors, tmp_path / "old.safetensors", {**metadata, "architecture": json.dumps(shape)})
    assert load_weights(tmp_path / "old.safetensors").shape == SMALL
