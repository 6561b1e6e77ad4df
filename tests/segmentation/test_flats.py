"""Flat pieces that meet at a few degrees."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.segmentation.flats import flat_pieces, with_flats


def bent(degrees: float, pieces: int, each: int = 30, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and normals on facets 0.05 wide about a common axis, each turned by so much, and their facets."""
    rng = np.random.default_rng(seed)
    points, normals, facet = [], [], np.repeat(np.arange(pieces), each)
    start = np.zeros(2)
    for k in range(pieces):
        angle = k * np.radians(degrees)
        way = np.array([np.cos(angle), np.sin(angle)])
        along = rng.uniform(0, 0.05, each)
        points.append(np.column_stack([start + along[:, None] * way, rng.uniform(0, 0.04, each)]))
        normals.append(np.tile([-way[1], way[0], 0.0], (each, 1)))
        start = start + 0.05 * way
    return np.vstack(points), np.vstack(normals).astype(np.float32).astype(float), facet


@pytest.mark.parametrize("degrees", [0.5, 5.0, 40.0])
def test_two_planes_are_told_apart_and_strays_belong_to_none(degrees: float) -> None:
    points, normals, facet = bent(degrees, 2)
    rng = np.random.default_rng(1)
    stray = rng.standard_normal((6, 3))
    stray /= np.linalg.norm(stray, axis=1)[:, None]
    pieces = flat_pieces(np.vstack([points, 0.1 * stray]), np.vstack([normals, stray]), 4)
    assert pieces is not None and (pieces[60:] == -1).all()
    assert {frozenset(pieces[:60][facet == k]) for k in (0, 1)} == {frozenset({0}), frozenset({1})}


def test_facets_of_a_round_face_stay_together() -> None:
    points, normals, _ = bent(5.0, 12)
    assert flat_pieces(points, normals, 4) is None


def test_noise_and_one_plane_are_no_pieces() -> None:
    points, normals, _ = bent(5.0, 2)
    assert flat_pieces(points, normals + 1e-2 * np.random.default_rng(0).standard_normal(points.shape), 4) is None
    assert flat_pieces(points[:30], normals[:30], 4) is None


def test_only_freeform_patches_are_taken_apart() -> None:
    points, normals, facet = bent(5.0, 2)
    both = np.vstack([points, points + np.eye(3)[2]]), np.vstack([normals, normals])
    labels, kinds = with_flats(*both, np.repeat([0, 1], 60), ["bspline", "cylinder"], 4)
    assert kinds == ["plane", "cylinder", "plane"] and (labels[60:] == 1).all()
    assert {tuple(np.unique(labels[:60][facet == k])) for k in (0, 1)} == {(0,), (2,)}
