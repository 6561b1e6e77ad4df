from dataclasses import replace

import numpy as np
import pytest

from sed2cad.evaluation import segmentation
from sed2cad.evaluation.methods import NETWORK, Labelling, grow_regions, labels_of, near_boundaries, run_method
from sed2cad.evaluation.metrics import match_patches
from sed2cad.evaluation.scores import ClassCounts, Seconds, score, summarise
from sed2cad.evaluation.segmentation import SegmentationSettings, score_part
from sed2cad.evaluation.trial import cloud_of, make_trial
from sed2cad.network.architecture import Architecture
from sed2cad.network.graph import MAX_POINTS
from sed2cad.network.sednet import SedNet
from sed2cad.network.types import BSPLINE, PLANE, SPHERE, TORUS
from sed2cad.network.weights import labeller_of
from sed2cad.primitives.base import Patch
from tests.evaluation.clouds import box, cube


def test_regions_are_the_sides_of_a_cube():
    cloud = cube()
    found = grow_regions(cloud.points.astype(float), cloud.normals.astype(float))
    assert match_patches(found, cloud.patch, None, cloud.type).p_miou_strict == 1


def test_boundaries_of_a_cube_are_its_edges():
    """Between planes the tangent planes give the edge exactly, wherever neighbours of two sides are."""
    cloud = cube(6_000)
    points, normals = cloud.points.astype(float), cloud.normals.astype(float)
    near = near_boundaries(points, normals, cloud.patch.astype(np.int64), 0.01)
    true = cloud.edge_distance < 0.01
    assert (near & true).sum() / true.sum() > 0.85
    assert (near & true).sum() / near.sum() > 0.98


def test_unlabelled_points_have_no_boundary():
    cloud = cube(600)
    patch = np.where(cloud.patch == 0, 0, -1)
    assert not near_boundaries(cloud.points.astype(float), cloud.normals.astype(float), patch, 0.5).any()


def test_labels_of_patches():
    inside = np.ones(2, bool)
    patch, type_ = labels_of([Patch(np.array([1, 3]), "plane", inside), Patch(np.array([0, 4]), "sphere", inside)], 5)
    assert patch.tolist() == [1, 0, -1, 0, 1]
    assert type_.tolist() == [SPHERE, PLANE, -1, PLANE, SPHERE]


def test_dropped_points_get_no_label():
    """A lonely point is no part of the scan; all others keep their place in the cloud's order."""
    cloud = cube(1_200)
    cloud.points[7] = [3, 3, 3]
    trial = make_trial(cloud, 0.0, 0)
    assert np.flatnonzero(trial.row < 0).tolist() == [7]
    found = trial.to_cloud(run_method("growing", trial.scan, None, 0.01))
    assert (found.patch[7], found.type, found.edge[7]) == (-1, None, False)
    rest = np.arange(1_200) != 7
    assert match_patches(found.patch[rest], cloud.patch[rest], None, cloud.type[rest]).p_miou_strict == 1


def test_noise_goes_along_the_normal():
    cloud = cube(1_200)
    trial = make_trial(cloud, 0.01, 0)
    moved = trial.scan.frame.to_world(trial.scan.points)[trial.row] - cloud.points
    kept = trial.row >= 0
    along = np.einsum("ij,ij->i", moved, cloud.normals)[kept]
    np.testing.assert_allclose(moved[kept], (along[:, None] * cloud.normals[kept]), atol=1e-6)
    radius = np.linalg.norm(cloud.points, axis=1).max()
    assert 0.009 * radius < np.abs(along).max() <= 0.01 * radius + 1e-6
    assert trial.scan.noise > 0.001


@pytest.mark.parametrize("points", [300, 12_000])
def test_cloud_of_draws_any_number_of_points(tmp_path, points):
    path = tmp_path / "box.npz"
    box().save(path)
    cloud = cloud_of(path, points, 1)
    assert len(cloud.points) == len(cloud.patch) == points
    np.testing.assert_array_equal(cloud.points, cloud_of(path, points, 1).points)
    assert (cloud.points != cloud_of(path, points, 2).points).any()
    assert len(cloud_of(path, None, 1).points) == MAX_POINTS


def test_noise_does_not_follow_the_order_of_the_triangles(tmp_path):
    """The generator of the noise is not the one that drew the points: displacements average out on every side."""
    path = tmp_path / "box.npz"
    box().save(path)
    cloud = cloud_of(path, 6_000, 0)
    trial = make_trial(cloud, 0.01, 0)
    kept = trial.row >= 0
    moved = trial.scan.frame.to_world(trial.scan.points)[trial.row[kept]] - cloud.points[kept]
    along = np.einsum("ij,ij->i", moved, cloud.normals[kept])
    for side in range(6):
        assert abs(along[cloud.patch[kept] == side].mean()) < 0.001


def test_a_network_without_torus_is_scored_without_torus(tmp_path, monkeypatch):
    """Truth torus, found B-spline, is right for the paper's classes and wrong for the others."""
    path = tmp_path / "box.npz"
    box().save(path)
    truth = cloud_of(path, 600, 0)
    truth = replace(truth, type=np.full(600, TORUS, np.int8))
    said = Labelling(truth.patch.astype(np.int64), np.full(600, BSPLINE), np.zeros(600, bool))
    monkeypatch.setattr(segmentation, "cloud_of", lambda *_: truth)
    monkeypatch.setattr(segmentation, "run_method", lambda method, scan, *_: said)
    settings = SegmentationSettings((NETWORK,), 600)
    shape = Architecture((8, 8, 8), 16, 16, 8, 4, 8, 1, 8, 2)
    for torus, right in ((True, 0), (False, 1)):
        row = score_part(path, settings, labeller_of(SedNet(replace(shape, torus=torus))))[0]
        assert (row.error, row.type_accuracy, row.t_miou) == ("", right, right)
        assert row.classes[TORUS].points == (600 if torus else 0)


def test_scores_of_a_part_and_of_two():
    cloud = cube(600)
    trial = make_trial(cloud, 0.0, 0)
    found = trial.to_cloud(run_method("growing", trial.scan, None, 0.01))
    row = score("cube", "growing", cloud, found, Seconds(1, 2, 3))
    assert row.p_miou == row.p_miou_strict == 1
    assert np.isnan([row.t_miou, row.type_accuracy]).all()
    assert row.classes[PLANE] == ClassCounts(600, 0, 6, 6.0)
    both = summarise([row, row])
    assert (both.parts, both.failed, both.classes[PLANE].points) == (2, 0, 1_200)
    assert both.edge_f1 == pytest.approx(row.edge.f1)
    assert both.seconds.total == 6
