import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from sed2cad.evaluation.segmentation import score_network
from sed2cad.network.sednet import Architecture
from sed2cad.network.weights import load_weights
from sed2cad.training.augment import estimate_normals, random_motion, turn
from sed2cad.training.labelled_part import LabelledCloud
from sed2cad.training.train import TrainSettings, main, train

SMALL = Architecture((8, 8, 8), 16, 16, 8, 4, 8, 1, 8, 2)


def folded_sheet(seed, n=3_000):
    """Two planes that meet in an edge along y."""
    rng = np.random.default_rng(seed)
    points, second = rng.random((n, 3)) - 0.5, rng.random(n) < 0.5
    points[~second, 2], points[second, 0] = -0.5, -0.5
    normals = np.where(second[:, None], [1.0, 0, 0], [0, 0, 1])
    distance = np.minimum(np.hypot(points[:, 0] + 0.5, points[:, 2] + 0.5), 0.1)
    return LabelledCloud(
        points.astype(np.float32),
        normals.astype(np.float32),
        normals.astype(np.float16),
        second.astype(np.int16),
        np.zeros(n, np.int8),
        distance.astype(np.float16),
    )


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packed")
    for seed in range(5):
        folded_sheet(seed).save(folder / f"{seed}.npz")
    return folder


def test_three_steps_then_resume_then_export(data, tmp_path):
    settings = TrainSettings(SMALL, rows=256, batch=2, pretrain_steps=5, log_steps=1, max_steps=3, threads=1)
    best = train(settings, data, tmp_path / "run")
    first = load_weights(best)
    lines = []
    train(replace(settings, max_steps=5), data, tmp_path / "run", lines.append)
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
    scores = score_network(sorted(data.glob("*.npz"))[:2], exported, noise=0.01)
    assert scores.parts == 2
    assert 0 <= scores.p_miou_strict <= scores.p_miou <= 1


def test_motion_is_orthogonal_up_to_scale():
    rng = np.random.default_rng(0)
    signs = set()
    for _ in range(40):
        motion = random_motion(rng)
        scale = np.cbrt(abs(np.linalg.det(motion)))
        assert 0.8 <= scale <= 1.1
        np.testing.assert_allclose(motion @ motion.T, scale**2 * np.eye(3), atol=1e-5)
        signs.add(np.sign(np.linalg.det(motion)))
    assert signs == {-1, 1}


def test_turn_keeps_within_its_angle():
    rng = np.random.default_rng(0)
    normals = np.tile([0.0, 0, 1], (500, 1))
    turned = turn(normals, 5.0, rng)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1)
    assert turned[:, 2].min() >= np.cos(np.radians(5.0))


def test_estimated_normals_of_a_plane():
    cloud = folded_sheet(0)
    plane = cloud.points[cloud.patch == 0]
    normals = estimate_normals(plane, np.tile([0.0, 0, 1], (len(plane), 1)), 8)
    np.testing.assert_allclose(normals, np.tile([0.0, 0, 1], (len(plane), 1)), atol=1e-4)
