from dataclasses import replace

import numpy as np
import pytest

from sed2cad.network.graph import neighbour_graph
from sed2cad.training.augment import (
    density,
    estimate_normals,
    flip_patch,
    missing_regions,
    random_motion,
    thin_out,
    turn,
    visible,
)
from sed2cad.training.samples import EDGE_DISTANCE, Faults, load_sample, make_sample
from sed2cad.training.settings import TrainSettings
from sed2cad.training.stream import BLOCK, Stream, make_batch
from tests.training.test_train import folded_sheet

UP = np.array([0.0, 0, 1])
ONCE = TrainSettings(rows=64, reuse=1)


def rng():
    return np.random.default_rng(0)


def test_motion_is_orthogonal_up_to_scale():
    draw, signs = rng(), set()
    for _ in range(40):
        motion = random_motion(draw)
        scale = np.cbrt(abs(np.linalg.det(motion)))
        assert 0.8 <= scale <= 1.1
        np.testing.assert_allclose(motion @ motion.T, scale**2 * np.eye(3), atol=1e-5)
        signs.add(np.sign(np.linalg.det(motion)))
    assert signs == {-1, 1}


def test_turn_keeps_within_its_angle():
    turned = turn(np.tile(UP, (500, 1)), 5.0, rng())
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1)
    assert turned[:, 2].min() >= np.cos(np.radians(5.0))


def test_estimated_normals_of_a_plane():
    plane = np.column_stack([rng().random((1_500, 2)) - 0.5, np.zeros(1_500)])
    normals = estimate_normals(plane, np.tile(UP, (1_500, 1)), neighbour_graph(plane)[0, :, :8])
    np.testing.assert_allclose(normals, np.tile(UP, (1_500, 1)), atol=1e-4)


def test_one_patch_is_flipped_as_a_whole():
    patch = np.repeat([0, 1, 2], 5)
    flipped = flip_patch(np.tile(UP, (15, 1)), patch, rng())[:, 2].reshape(3, 5)
    assert sorted(flipped.sum(1)) == [-5, 5, 5]


def test_only_the_facing_and_nearest_points_are_visible():
    """Two parallel squares one behind the other, and the same turned away."""
    flat = np.column_stack([rng().random((9_000, 2)) - 0.5, np.zeros(9_000)])
    points = np.vstack([flat + 0.3 * UP, flat])
    normals, eye = np.tile(UP, (18_000, 1)), np.array([0.01, 0, 2.0])
    seen = visible(points, normals, eye)
    assert seen[:9_000].mean() > 0.99
    assert seen[9_000:][abs(flat[:, :2]).max(1) < 0.4].mean() < 0.02
    assert not visible(points, -normals, eye).any()


def test_missing_regions_leave_enough():
    cloud, draw = folded_sheet().sample(rng(), 2_000), rng()
    shares = [missing_regions(cloud.points, cloud.normals, draw).mean() for _ in range(60)]
    assert 0.3 <= min(shares) < 0.7
    assert max(shares) <= 1


def test_thinning_follows_the_weights():
    weight = np.where(np.arange(4_000) < 2_000, 1.0, 4.0)
    kept = thin_out(weight, 800, rng())
    assert len(np.unique(kept)) == 800
    assert 0.72 < (kept >= 2_000).mean() < 0.85
    assert len(thin_out(weight, 9_999, rng())) == 4_000


def test_density_is_positive():
    cloud, draw = folded_sheet().sample(rng(), 500), rng()
    assert min(density(cloud.points, cloud.normals, draw).min() for _ in range(20)) > 0


@pytest.mark.parametrize(
    "faults",
    [Faults(), Faults(noise=True), Faults(estimated=True), Faults(partial=True), Faults(True, True, True, True)],
)
def test_every_fault_makes_a_proper_sample(faults):
    sample = make_sample(folded_sheet(), faults, rng(), 500)
    n = len(sample.points)
    assert (3_000 <= n <= 10_000) if faults.uneven or faults.partial else n == 10_000
    assert sample.neighbours.shape == (3, n, 16)
    assert sample.neighbours[2].max() < 256
    assert len(sample.edge) == 500
    assert sample.edge.mean() < 0.1
    np.testing.assert_allclose(np.linalg.norm(sample.normals, axis=1), 1, atol=1e-3)
    if not (faults.noise or faults.estimated or faults.partial):
        true = np.where(sample.patch[:, None] == 0, UP, [1, 0, 0])
        np.testing.assert_allclose(sample.normals, true, atol=1e-6)
        distance = np.hypot(sample.points[:500, 0] + 0.5, sample.points[:500, 2] + 0.5)
        sure = abs(distance - EDGE_DISTANCE) > 1e-3
        np.testing.assert_array_equal(sample.edge[sure], (distance < EDGE_DISTANCE)[sure])


@pytest.mark.parametrize("faults", [Faults(), Faults(partial=True), Faults(True, True, True, True)])
@pytest.mark.parametrize("points", [400, 3_000])
def test_small_clouds_have_the_points_asked_for(faults, points):
    """All as many, whatever is missing: a batch's tables of neighbours rely on it below 2,048 points."""
    sample = make_sample(folded_sheet(), faults, rng(), 300, points)
    assert len(sample.points) == len(sample.normals) == len(sample.patch) == points
    assert sample.neighbours.shape == (3, points, 16) and sample.neighbours[0].max() < points
    assert len(sample.edge) == 300


def test_half_of_the_clouds_are_clean():
    draw = rng()
    drawn = [Faults.draw(draw) for _ in range(400)]
    assert 0.4 < np.mean([faults == Faults() for faults in drawn]) < 0.6
    for name in ("noise", "estimated", "partial", "uneven"):
        assert 0.2 < np.mean([getattr(faults, name) for faults in drawn]) < 0.35


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packed")
    paths = [folder / f"{index}.npz" for index in range(3)]
    for index, path in enumerate(paths):
        folded_sheet(0.5 + 0.2 * index).save(path)
    return paths


def test_the_key_decides_the_sample(parts):
    first, again, other = (load_sample(parts[0], key, 64) for key in ((0, 1), (0, 1), (0, 2)))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.normals, again.normals)
    assert first.points.shape != other.points.shape or (first.points != other.points).any()


def numbers(stream, places):
    return [stream._number(place) for place in range(places)]


def test_each_sample_comes_as_often_as_it_is_reused_within_its_block(parts):
    stream = Stream(parts, replace(ONCE, reuse=2))
    drawn = numbers(stream, 4 * BLOCK)
    assert sorted(drawn[: 2 * BLOCK]) == sorted([*range(BLOCK), *range(BLOCK)])
    assert sorted(drawn[2 * BLOCK :]) == sorted([*range(BLOCK, 2 * BLOCK)] * 2)


def test_processes_share_the_samples_out(parts):
    both = [numbers(Stream(parts, ONCE, rank=rank, size=2), BLOCK) for rank in (0, 1)]
    assert sorted([*both[0], *both[1]]) == [*range(2 * BLOCK)]


def test_batch_does_not_depend_on_what_came_before(parts):
    resumed, running = Stream(parts, ONCE), Stream(parts, ONCE)
    running.samples(0, 2)
    for a, b in zip(running.samples(1, 2), resumed.samples(1, 2)):
        np.testing.assert_array_equal(a.points, b.points)
    batch, target = make_batch(running.samples(1, 2), 64, rng())
    assert batch.clouds == 2
    assert len(target.type) == len(target.edge) == len(target.patch) == 2 * batch.rows
    assert len(target.cloud) == int(target.patch.max()) + 1


def test_points_of_the_settings_reach_the_samples(parts):
    samples = Stream(parts, replace(ONCE, points=500)).samples(0, 8)
    assert [len(sample.points) for sample in samples] == [500] * 8
