"""What prepare promises: unit frame, invariance, outliers, and one sentence for useless scans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sed2cad.errors import ScanError
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan, ScanWarning
from sed2cad.scan.scan import Array, Scan
from tests.parts import box_points, shaft_points


def by_place(scan: Scan, turn: Array) -> tuple[Array, Array]:
    """World points turned back, sorted, and their normals."""
    points = scan.frame.to_world(scan.points) @ turn
    order = np.lexsort(points.round(5).T)
    return points[order], (scan.normals @ turn)[order]


def test_unit_frame() -> None:
    points, normals = box_points(3000)
    scan = prepare(RawScan(points + 100, normals), 0)
    assert np.linalg.norm(np.ptp(scan.points, axis=0)) == pytest.approx(1)
    np.testing.assert_allclose(scan.points.min(axis=0), -scan.points.max(axis=0), atol=1e-12)
    back = scan.frame.to_world(scan.points)
    np.testing.assert_allclose(back[np.lexsort(back.T)], (points + 100)[np.lexsort(points.T)], atol=1e-9)


def test_shuffling_changes_nothing_at_all() -> None:
    points, normals = shaft_points(2000)
    order = np.random.default_rng(5).permutation(2000)
    for one, other in [(RawScan(points), RawScan(points[order])),
                       (RawScan(points, normals), RawScan(points[order], normals[order]))]:
        first, second = prepare(one, 0), prepare(other, 0)
        np.testing.assert_array_equal(first.points, second.points)
        np.testing.assert_array_equal(first.normals, second.normals)
        assert (first.noise, first.spacing) == (second.noise, second.spacing)


@settings(max_examples=6, deadline=None)
@given(
    st.integers(0, 2**31),
    st.floats(1e-3, 1e3),
    st.tuples(*[st.floats(-100, 100)] * 3),
)
def test_motion_and_scale(seed: int, scale: float, shift: tuple[float, float, float]) -> None:
    points, normals = shaft_points(2000)
    points = points + np.random.default_rng(0).normal(0, 0.05, points.shape)
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    still = prepare(RawScan(points), 0)
    moved = prepare(RawScan(scale * (points @ turn.T) + scale * np.array(shift)), 0)
    back = moved.frame.to_world(moved.points) / scale - shift
    place = np.lexsort((back @ turn).round(5).T)
    points, normals = by_place(still, np.eye(3))
    np.testing.assert_allclose((back @ turn)[place], points, atol=1e-5)
    cosine = np.einsum("ij,ij->i", (moved.normals @ turn)[place], normals)
    assert np.mean(cosine > 0.99) > 0.98
    zoom = scale * still.frame.scale / moved.frame.scale
    assert moved.noise == pytest.approx(still.noise * zoom, rel=0.15)
    assert moved.spacing == pytest.approx(still.spacing * zoom, rel=1e-3)


def test_outliers_go_and_true_points_stay() -> None:
    rng = np.random.default_rng(2)
    points, _ = box_points(20_000)
    points = points + rng.normal(0, 0.02, points.shape)
    outliers = rng.uniform(-30, 30, (60, 3))
    beyond = np.abs(outliers) - [20, 15, 10]  # those nearer than three spacings to a face cannot be told
    outliers = outliers[(np.abs(beyond).min(axis=1) > 1.5) | (beyond.max(axis=1) > 1.5)]
    scan = prepare(RawScan(np.vstack([points, outliers])), 0)
    kept = {tuple(p) for p in scan.frame.to_world(scan.points).round(6)}
    assert sum(tuple(p) in kept for p in points.round(6)) > 19_990
    assert sum(tuple(p) in kept for p in outliers.round(6)) == 0


def test_scans_in_lines_lose_nothing() -> None:
    points, normals = box_points(8000)
    points[:, 0] = points[:, 0].round()  # 1 mm between the lines
    assert len(prepare(RawScan(points, normals), 0).points) > 0.999 * 8000


def test_few_bad_points_and_duplicates_are_dropped_with_a_warning() -> None:
    points, normals = box_points(1000)
    points[3, 1], points[7, 0], points[9] = np.nan, np.inf, points[8]
    with pytest.warns(ScanWarning) as caught:
        scan = prepare(RawScan(points, normals, name="a.ply"), 0)
    assert len(scan.points) == 997
    assert [str(w.message) for w in caught] == [
        "a.ply: 2 points with NaN or infinity dropped", "a.ply: 1 duplicate points removed"
    ]


def test_a_thin_plate_is_no_plane() -> None:
    points, normals = box_points(4000, (60, 40, 0.2))
    for raw in (RawScan(points), RawScan(points, normals)):
        assert len(prepare(raw, 0).points) == 4000


def useless() -> dict[str, tuple[Array, str]]:
    points, _ = box_points(1000)
    line, flat, tilted, holes = points.copy(), points.copy(), points.copy(), points.copy()
    line[:, 1:] = 5
    flat[:, 2] = 5
    tilted[:, 2] = tilted[:, 0] + 0.3 * tilted[:, 1]
    holes[:20] = np.nan
    rough = np.random.default_rng(0).normal(0, 1, (1000, 3)) * [20, 15, 0.05]
    return {
        "few": (points[:49], "only 49 points, a scan needs 50; scan the part denser"),
        "none": (points[:0], "only 0 points, a scan needs 50; scan the part denser"),
        "copies": (points[np.arange(1000) % 20], "only 20 of its 1000 points are distinct"),
        "place": (points[np.zeros(1000, int)], "only 1 of its 1000 points are distinct"),
        "line": (line, "all points lie on one line"),
        "plane": (flat, "all points lie on one plane"),
        "tilted plane": (tilted, "all points lie on one plane"),
        "noisy plane": (rough, "all points lie on one plane"),
        "NaN": (holes, "20 of 1000 points are NaN or infinite"),
    }


@pytest.mark.filterwarnings("ignore::sed2cad.scan.raw.ScanWarning")
@pytest.mark.parametrize("case", useless())
def test_useless_scans(case: str) -> None:
    points, sentence = useless()[case]
    with pytest.raises(ScanError, match=rf"^a\.ply: {sentence}"):
        prepare(RawScan(points, name="a.ply"), 0)
