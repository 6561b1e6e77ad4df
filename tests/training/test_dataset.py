import json
from math import pi

import numpy as np
import pytest

from sed2cad.network.types import CYLINDER, PLANE
from sed2cad.training.dataset import build_dataset, load_part, packed_parts
from tests.training.cadparts import write


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """Two CAD files, one damaged file, packed."""
    from build123d import Box, Cylinder

    parts, out = tmp_path_factory.mktemp("parts"), tmp_path_factory.mktemp("packed")
    (parts / "deep").mkdir()
    write(Box(40, 30, 20) - Cylinder(5, 20), parts / "holed.step")
    write(Cylinder(5, 20), parts / "deep" / "rod.brep")
    (parts / "bad.stp").write_text("nothing")
    calls = []
    report = build_dataset(parts, out, workers=1, progress=lambda *call: calls.append(call))
    return report, calls, out


def test_one_bad_file_does_not_stop_the_run(packed):
    report, calls, out = packed
    assert report.packed == packed_parts(out) == [out / "deep_rod.npz", out / "holed.npz"]
    assert [path.name for path in report.skipped] == ["bad.stp"]
    assert all(report.skipped.values())
    assert [call[:2] for call in calls] == [(1, 3), (2, 3), (3, 3)]


def test_report_is_written(packed):
    report, _, out = packed
    written = json.loads((out / "report.json").read_text())
    assert written["files"] == 2
    assert [reason for reason in written["skipped"].values()] == list(report.skipped.values())
    assert (written["faces"]["plane"], written["faces"]["cylinder"]) == (8, 2)
    assert sum(written["disguised"].values()) == 0
    assert 0 < written["megabytes"] < 0.02
    assert "2 parts" in str(report)
    assert "1 files skipped" in str(report)


def test_labels_of_a_box_with_a_hole(packed):
    cloud = load_part(packed[2] / "holed.npz").sample(np.random.default_rng(0), 4_000)
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
    cloud = load_part(packed[2] / "holed.npz").sample(np.random.default_rng(0), 4_000)
    x, y, z = (cloud.points * 40).T
    top = (z > 10 - 1e-4) & (np.hypot(x, y) > 12)
    expected = np.minimum(np.minimum(20 - abs(x), 15 - abs(y)) / 40, 0.1)[top]
    np.testing.assert_allclose(cloud.edge_distance[top], expected, atol=1.6e-3)


def test_a_seam_is_no_edge(packed):
    cloud = load_part(packed[2] / "deep_rod.npz").sample(np.random.default_rng(0), 4_000)
    assert cloud.patch.max() + 1 == 3
    middle = (cloud.type == CYLINDER) & (abs(cloud.points[:, 2]) < 0.3)
    assert cloud.edge_distance[middle].min() > 0.09
