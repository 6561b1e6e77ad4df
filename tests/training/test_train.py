import json
import os
import socket
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
import torch

from sed2cad.evaluation import trial
from sed2cad.evaluation.segmentation import score_network
from sed2cad.network.architecture import Architecture
from sed2cad.network.sednet import SedNet
from sed2cad.network.weights import labeller_of, load_weights, save_weights
from sed2cad.training import parallel
from sed2cad.training.__main__ import main
from sed2cad.training.labelled_part import EDGE_UNIT, LabelledPart
from sed2cad.training.parallel import Team
from sed2cad.training.settings import PRESETS, TrainSettings
from sed2cad.training.train import _Run, split_parts, train

SMALL = Architecture((8, 8, 8), 16, 16, 8, 4, 8, 1, 8, 2)


def folded_sheet(height=1.0):
    """Two planes, x = -0.5 and z = -0.5, that meet in an edge along y."""
    corners = np.array([[-0.5, -0.5, -0.5], [-0.5, 0.5, -0.5], [0.5, -0.5, -0.5], [0.5, 0.5, -0.5]])
    wall = corners[[0, 1]] + [0, 0, height]
    triangles = np.array([[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]])
    return LabelledPart(
        np.vstack([corners, wall]).astype(np.float32),
        np.zeros((6, 3), np.int16),
        triangles.astype(np.uint16),
        np.array([0, 0, 1, 1], np.uint16),
        np.array([0, 1], np.int16),
        np.zeros(2, np.int8),
        np.zeros(2, bool),
        np.zeros(2, bool),
        np.ones(2, np.int8),
        np.tile(corners[0], (2, 1)),
        np.array([[0.0, 0, 1], [1, 0, 0]]),
        np.zeros((2, 2)),
        np.rint(corners[:2] / EDGE_UNIT).astype(np.int16),
        np.zeros(1, np.uint16),
    )


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packed")
    for index in range(5):
        folded_sheet(0.5 + 0.1 * index).save(folder / f"{index}.npz")
    return folder


@pytest.fixture(autouse=True)
def small_clouds(monkeypatch):
    """Validation on fewer points than the network can see."""
    monkeypatch.setattr(trial, "MAX_POINTS", 2_000)


QUICK = TrainSettings(SMALL, rows=256, batch=2, pretrain_steps=5, log_steps=1, max_steps=3, device="cpu")


def test_three_steps_then_resume_then_export(data, tmp_path):
    best = train(QUICK, data, tmp_path / "run")
    first = load_weights(best)
    lines = []
    train(replace(QUICK, max_steps=5), data, tmp_path / "run", lines.append)
    assert [line["step"] for line in lines if "loss" in line] == [4, 5]
    logged = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in logged if "loss" in line] == [1, 2, 3, 4, 5]
    assert all(np.isfinite(line["loss"]) for line in logged if "loss" in line)
    times = [line["minutes"] for line in logged]
    assert times == sorted(times)
    main(["export", str(tmp_path / "run"), str(tmp_path / "out.safetensors")])
    exported = load_weights(tmp_path / "out.safetensors")
    assert exported.affinity is not None
    torch.testing.assert_close(exported.local.mean, first.local.mean, atol=1e-2, rtol=1e-2)
    scores = score_network(sorted(data.glob("*.npz"))[:2], labeller_of(exported), noise=0.01)
    assert scores.parts == 2
    assert 0 <= scores.p_miou_strict <= scores.p_miou <= 1


def test_warm_start_keeps_the_weights_and_their_architecture(data, tmp_path):
    best = train(QUICK, data, tmp_path / "first")
    lines = []
    rest = replace(QUICK, architecture=Architecture(), init=best, max_steps=1, learning_rate=1e-9)
    warm = load_weights(train(rest, data, tmp_path / "second", lines.append))
    assert warm.shape == SMALL
    assert not any("pretrain_type_accuracy" in line for line in lines)
    for name, tensor in load_weights(best).state_dict().items():
        torch.testing.assert_close(warm.state_dict()[name], tensor, atol=1e-6, rtol=1e-5)
    assert (tmp_path / "second" / "affinity.safetensors").read_bytes() == (
        tmp_path / "first" / "affinity.safetensors"
    ).read_bytes()


def test_held_out_parts_are_real_and_the_same_each_time(data, tmp_path):
    folded_sheet().save(tmp_path / "made.npz")
    trained, held_out = split_parts(QUICK, [data, tmp_path])
    again = split_parts(QUICK, [data])
    assert held_out == again[1]
    assert [path.parent for path in held_out] == [data]
    assert trained == [*again[0], tmp_path / "made.npz"]
    assert split_parts(replace(QUICK, parts=2), [data, tmp_path]) == (trained[:2], held_out)


def test_the_learning_rate_falls_to_its_least_by_the_last_step(data, tmp_path):
    """Over the steps where these are fewer than fit into the time."""
    settings = replace(QUICK, pretrain_steps=1, warm_up=1, max_steps=4, validation_parts=1, pair_network=False)
    run = _Run(settings, [data], tmp_path, Team.join("cpu"), None)
    rates, step = [], run._one_step
    run._one_step = lambda progress: (step(progress), rates.append(run.optimizer.param_groups[0]["lr"]))[0]
    run.run()
    share = np.array(rates) / settings.learning_rate
    np.testing.assert_allclose(share, (1 + np.cos(np.pi * np.arange(4) / 4)) / 2, atol=0.01)
    assert not (tmp_path / "affinity.safetensors").exists()


def test_the_papers_way_trains(data, tmp_path):
    """Its settings in small: graphs rebuilt before each layer, its classes, epochs instead of minutes."""
    shape = replace(PRESETS["paper"]().architecture, widths=(8, 8, 8), global_width=16, point_width=16, dynamic=8)
    settings = replace(PRESETS["paper"](), architecture=shape, rows=256, batch=2, epochs=1, device="cpu")
    best = train(replace(settings, pretrain_steps=2, validation_parts=1), data, tmp_path / "run")
    network = load_weights(best)
    assert (network.shape.torus, network.shape.dynamic) == (False, 8)
    state = torch.load(tmp_path / "run" / "state.pt", weights_only=True)
    assert state["step"] == 2  # 4 parts, 2 a step


def run_rank(rank, port, data, out):
    """One of two processes, as torchrun starts them."""
    place = {"RANK": rank, "WORLD_SIZE": 2, "LOCAL_RANK": rank, "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    os.environ.update({name: str(value) for name, value in place.items()})
    torch.manual_seed(rank)  # each starts from other weights
    team = Team.join("cpu")
    run = _Run(replace(QUICK, max_steps=2, validation_parts=1), [data], out, team, None)
    run.run()
    save_weights(run.network, out / f"rank{rank}.safetensors")
    team.leave()


def run_rank_one(_, *place):
    run_rank(1, *place)


def test_two_processes_have_the_same_weights(data, tmp_path, monkeypatch):
    monkeypatch.setattr(parallel, "PATIENCE", timedelta(minutes=2))
    for name in ("RANK", "WORLD_SIZE", "LOCAL_RANK", "MASTER_ADDR", "MASTER_PORT"):
        monkeypatch.setenv(name, "")  # put back afterwards
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    other = torch.multiprocessing.spawn(run_rank_one, (port, data, tmp_path), join=False)
    run_rank(0, port, data, tmp_path)
    assert other.join()
    first, second = (load_weights(tmp_path / f"rank{rank}.safetensors").state_dict() for rank in (0, 1))
    start = SedNet(SMALL).state_dict()
    for name, tensor in first.items():
        torch.testing.assert_close(tensor, second[name], atol=0, rtol=0)
    assert any(not torch.equal(tensor, start[name]) for name, tensor in first.items())
    lines = (tmp_path / "log.jsonl").read_text().splitlines()
    assert [json.loads(line)["step"] for line in lines if "type_loss" in line] == [1, 2]
