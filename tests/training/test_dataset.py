from math import pi

import numpy as np
import pytest

from sed2cad.network.types import CYLINDER, PLANE
from sed2cad.training.dataset import build_dataset, load_cloud
from sed2cad.training.samples import EDGE_DISTANCE, VARIANTS, load_sample


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """Two CAD files, one damaged file, packed."""
    from build123d import Box, Cylinder, export_brep, export_step

    parts, out = tmp_path_factory.mktemp("parts"), tmp_path_factory.mktemp("packed")
    export_step(Box(40, 30, 20) - Cylinder(5, 20), parts / "holed.step")
    (parts / "deep").mkdir()
    export_brep(Cylinder(5, 20), parts / "deep" / "rod.brep")
    (parts / "bad.stp").write_text("nothing")
    calls = []
    report = build_dataset(parts, out, workers=1, progress=lambda *call: calls.append(call), count=4_000)
    return report, calls, out


def test_report(packed):
    report, calls, out = packed
    assert report.packed == [out / "deep_rod.npz", out / "holed.npz"]
    assert [path.name for path in report.skipped] == ["bad.stp"]
    assert all(report.skipped.values())
    assert [call[:2] for call in calls] == [(1, 3), (2, 3), (3, 3)]


def test_labels_of_a_box_with_a_hole(packed):
    cloud = load_cloud(packed[2] / "holed.npz")
    assert len(cloud.points) == 4_000
    assert cloud.patch.max() + 1 == 7
    assert set(cloud.type) == {PLANE, CYLINDER}
    wall = 2 * pi * 5 * 20
    area = 2 * (40 * 30 + 40 * 20 + 30 * 20) - 2 * pi * 25 + wall
    assert (cloud.type == CYLINDER).mean() == pytest.approx(wall / area, abs=0.03)
    on_wall = cloud.type == CYLINDER
    np.testing.assert_allclose(np.linalg.norm(cloud.points[on_wall, :2], axis=1), 5 / 40, atol=1e-6)
    outward = cloud.points[on_wall, :2] * 8
    np.testing.assert_allclose(cloud.normals[on_wall, :2], -outward, atol=1e-5)


def test_distance_to_edges(packed):
    """On the top of the box away from the hole the nearest edge is the nearest side."""
    cloud = load_cloud(packed[2] / "holed.npz")
    x, y, z = (cloud.points * 40).T
    top = (z > 10 - 1e-4) & (np.hypot(x, y) > 12)
    expected = np.minimum(np.minimum(20 - abs(x), 15 - abs(y)) / 40, 0.1)[top]
    np.testing.assert_allclose(cloud.edge_distance[top], expected, atol=1.6e-3)


def test_a_seam_is_no_edge(packed):
    cloud = load_cloud(packed[2] / "deep_rod.npz")
    assert cloud.patch.max() + 1 == 3
    middle = (cloud.type == CYLINDER) & (abs(cloud.points[:, 2]) < 0.3)
    assert cloud.edge_distance[middle].min() > 0.09


def test_samples_are_cached_and_the_same_each_time(packed):
    path = packed[2] / "holed.npz"
    for variant in range(VARIANTS):
        made, cached = load_sample(path, variant), load_sample(path, variant)
        np.testing.assert_array_equal(made.points, cached.points)
        assert made.neighbours.shape == (3, len(made.points), 16)
        assert made.neighbours[2].max() < 256
        assert np.allclose(np.linalg.norm(made.normals, axis=1), 1, atol=1e-3)
    clean = load_sample(path, 0)
    assert clean.edge.mean() == pytest.approx((load_cloud(path).edge_distance < EDGE_DISTANCE).mean())
    assert (path.parent / "cache" / "holed_0.npz").exists()
