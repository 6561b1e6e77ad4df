import numpy as np
import pytest

from sed2cad.errors import UsageError
from sed2cad.evaluation.methods import grow_regions, labels_of, near_boundaries, run_method
from sed2cad.evaluation.metrics import match_patches
from sed2cad.evaluation.scores import ClassCounts, Seconds, score, summarise
from sed2cad.evaluation.trial import cloud_of, make_trial
from sed2cad.network.types import PLANE, SPHERE
from sed2cad.primitives.base import Patch
from tests.evaluation.clouds import cube


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


def test_cloud_of_takes_as_many_points_as_there_are(tmp_path):
    path = tmp_path / "cube.npz"
    cube(600).save(path)
    some = cloud_of(path, 300, 1)
    assert len(some.points) == len(some.patch) == 300
    np.testing.assert_array_equal(some.points, cloud_of(path, 300, 1).points)
    with pytest.raises(UsageError, match="holds 600 points, not 601"):
        cloud_of(path, 601, 0)


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
