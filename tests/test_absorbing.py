"""Chips along edges go to the faces that their points lie on; small faces stay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.absorbing import absorbed
from sed2cad.fitting import fit_patches
from sed2cad.primitives.base import Patch
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Scan
from tests.segmentation.shapes import Array, box

NOISE = 1e-3


def scanned(points: Array, face: NDArray[np.int64], normals: Array | None) -> tuple[Scan, NDArray[np.int64]]:
    """A scan with noise, its normals estimated where none are given, and the face of each of its points."""
    points = points + np.random.default_rng(1).normal(0, NOISE, points.shape)
    scan = prepare(RawScan(points, normals), seed=0)
    return scan, face[cKDTree(points).query(scan.frame.to_world(scan.points))[1]]


def patches(labels: NDArray[np.int64]) -> list[Patch]:
    return [
        Patch(own, "plane", np.ones(len(own), bool))
        for k in range(labels.max() + 1)
        if len(own := np.flatnonzero(labels == k))
    ]


@pytest.mark.parametrize("turned", [False, True])
def test_a_chip_on_an_edge_goes_to_the_faces_beside_it(turned: bool) -> None:
    points, _, face = box((1.0, 0.8, 0.5), 30_000)
    scan, truth = scanned(points, face, None)
    middle = np.array([0.5, 0.4, 0.0])  # of an edge between the faces 1 and 3
    chip = np.argsort(np.linalg.norm(scan.frame.to_world(scan.points) - middle, axis=1))[:15]
    assert set(truth[chip]) == {1, 3}
    if turned:  # the side of an estimated normal is a guess, and whole groups of them go wrong
        scan.normals[chip] *= -1
    labels = truth.copy()
    labels[chip] = 6
    found = absorbed(scan, fit_patches(scan, patches(labels)))
    assert len(found) == 6
    assert sum(len(patch.patch.indices) for patch in found) == len(scan.points)
    for number, patch in enumerate(found):
        inner = patch.patch.indices[patch.patch.interior]
        assert not np.isin(chip, inner).any()
        assert (truth[patch.patch.indices] != number).sum() <= 5  # points on the edge lie on both faces


def test_a_strip_of_points_that_err_outwards_is_no_face() -> None:
    """Some plane lies better among points that were picked for their errors."""
    points, _, face = box((1.0, 0.8, 0.5), 30_000)
    scan, truth = scanned(points, face, None)
    world = scan.frame.to_world(scan.points)
    beside = (truth == 1) & (world[:, 1] > 0.33)  # the edge with face 3
    strip = np.flatnonzero(beside & (world[:, 0] > 0.5))
    assert 100 < len(strip) < 400
    labels = truth.copy()
    labels[strip] = 6
    assert len(absorbed(scan, fit_patches(scan, patches(labels)))) == 6


@pytest.mark.parametrize("measured", [False, True])
def test_a_chamfer_stays(measured: bool) -> None:
    points, normals, face = box((1.0, 0.8, 0.5), 30_000)
    across = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    height = points @ across - (0.9 - 0.03) / np.sqrt(2)  # over a chamfer that cuts 0.03 off an edge
    cut = height > 0
    points[cut] -= height[cut, None] * across
    normals[cut], face[cut] = across, 6
    scan, truth = scanned(points, face, normals if measured else None)
    fitted = fit_patches(scan, patches(truth))
    assert len(absorbed(scan, fitted)) == 7
    few = np.flatnonzero(truth == 6)[::25]  # 12 points of it, the others lost
    keep = np.sort(np.concatenate([np.flatnonzero(truth != 6), few]))
    less = Scan(scan.points[keep], scan.normals[keep], None, scan.frame, scan.noise, scan.spacing)
    assert len(absorbed(less, fit_patches(less, patches(truth[keep])))) == 7


def test_a_small_face_stays_though_it_has_points_of_others() -> None:
    """A rounded edge, of which a few points are known, and two strangers among them."""
    points, normals, face = box((1.0, 0.8, 0.5), 30_000)
    scan, truth = scanned(points, face, normals)
    radius, few = 0.01, 16
    angle, along = np.linspace(0.1, np.pi / 2 - 0.1, few), np.random.default_rng(0).uniform(0.2, 0.3, few)
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(few)])
    round_ = np.array([0.5 - radius, 0.4 - radius, 0]) + radius * out + along[:, None] * np.eye(3)[2]
    strangers = scan.frame.to_world(scan.points[truth == 4][:2])
    scan = Scan(
        np.vstack([scan.points, scan.frame.to_unit(np.vstack([round_, strangers]))]),
        np.vstack([scan.normals, out, -out[:2]]),
        None,
        scan.frame,
        0.0,
        scan.spacing,
    )
    labels = np.concatenate([truth, np.full(few + 2, 6)])
    own = np.flatnonzero(labels == 6)
    found = fit_patches(scan, [*patches(truth), Patch(own, "cylinder", np.ones(len(own), bool))])
    assert len(absorbed(scan, found)) == 7


def test_order_and_untouched_patches_are_kept() -> None:
    points, normals, face = box((1.0, 0.8, 0.5), 5_000)
    scan, truth = scanned(points, face, normals)
    fitted = fit_patches(scan, patches(truth))
    assert all(one is other for one, other in zip(absorbed(scan, fitted), fitted, strict=True))
