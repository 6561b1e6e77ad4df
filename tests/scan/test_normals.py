"""Normals from points alone: directions, outward sign, noise."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.scan.noise import noise_level
from sed2cad.scan.normals import tangents
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Array, Scan
from tests.parts import box_points, shaft_points

SHAPES = {"box": box_points, "plate": lambda n: box_points(n, (60, 40, 1.5)), "shaft": shaft_points}


def errors(scan: Scan, points: Array, normals: Array) -> tuple[float, float]:
    """Mean angle in degrees up to sign, and the share of wrong signs among normals that are about right."""
    order = np.lexsort(scan.frame.to_world(scan.points).round(6).T)
    true = normals[np.lexsort(points.round(6).T)]
    cosine = np.einsum("ij,ij->i", scan.normals[order], true)
    sure = np.abs(cosine) > 0.5
    return float(np.degrees(np.arccos(np.abs(cosine).clip(0, 1))).mean()), float((cosine[sure] < 0).mean())


@pytest.mark.parametrize("shape", SHAPES)
def test_clean(shape: str) -> None:
    points, normals = SHAPES[shape](4000)
    scan = prepare(RawScan(points), 0)
    angle, wrong = errors(scan, points, normals)
    assert angle < (6 if shape == "plate" else 4)  # the plate is as thin as the points lie apart
    assert wrong < 0.005
    assert scan.noise * scan.frame.scale < 0.02
    np.testing.assert_allclose(np.linalg.norm(scan.normals, axis=1), 1)


@pytest.mark.parametrize("shape", ["box", "shaft"])
def test_noise_is_measured(shape: str) -> None:
    points, normals = SHAPES[shape](6000)
    noisy = points + np.random.default_rng(1).normal(0, 0.1, points.shape)
    given = prepare(RawScan(noisy, normals), 0)
    alone = prepare(RawScan(noisy), 0)
    assert given.noise * given.frame.scale == pytest.approx(0.1, rel=0.1)
    assert alone.noise * alone.frame.scale == pytest.approx(0.1, rel=0.15)
    angle, wrong = errors(alone, noisy, normals)
    assert angle < 10 and wrong < 0.01


def test_the_normals_of_a_fillet_turn_with_it() -> None:
    """A quarter of a cylinder between two planes, four points wide, with noise: planes alone leave a median of 12
    degrees, as those of the flat neighbours look surer."""
    rng = np.random.default_rng(0)
    pitch, radius = 0.1, 0.27
    length, flat = 6.0, 3.0
    angle = rng.uniform(0, np.pi / 2, int(radius * np.pi / 2 * length / pitch**2))
    turn, still = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)]), np.zeros(int(flat * length / pitch**2))
    along = rng.uniform(-flat, 0, len(still))
    top, side = np.column_stack([along, still, still + radius]), np.column_stack([still + radius, still, along])
    flat_normals = np.repeat([[0.0, 0, 1], [1, 0, 0]], len(still), axis=0)
    points, normals = np.vstack([radius * turn, top, side]), np.vstack([turn, flat_normals])
    points[:, 1] = rng.uniform(0, length, len(points))
    points += normals * rng.normal(0, 0.0127, (len(points), 1))
    found = tangents(points / 8).normals
    off = np.degrees(np.arccos(np.abs(np.einsum("ij,ij->i", found, normals)).clip(0, 1)))
    assert np.median(off[: len(angle)]) < 7
    assert np.median(off[len(angle) :]) < 1.5


def test_a_hollow_box_has_its_inner_normals_into_the_cavity() -> None:
    outer, out = box_points(6000, (40, 40, 40))
    inner, into = box_points(3000, (20, 20, 20), seed=1)
    points, normals = np.vstack([outer, inner]), np.vstack([out, -into])
    assert errors(prepare(RawScan(points), 0), points, normals)[1] < 0.005


@pytest.mark.parametrize("turn", [1, -1])
def test_given_normals_are_turned_as_a_whole(turn: int) -> None:
    points, normals = shaft_points(3000)
    scan = prepare(RawScan(points, 7.5 * turn * normals), 0)
    angle, wrong = errors(scan, points, normals)
    assert wrong == 0 and angle < 1e-3


def test_normals_that_agree_are_kept_in_a_cup() -> None:
    """Of the inside of a cup the outside sees little, and votes wrongly on a third of all points."""
    outer, out = box_points(1200, (40, 40, 40))
    inner, into = box_points(1200, (36, 36, 36), seed=1)
    wall, lining = outer[:, 2] < 20 - 1e-6, inner[:, 2] < 18 - 1e-6
    points, normals = np.vstack([outer[wall], inner[lining]]), np.vstack([out[wall], -into[lining]])
    assert errors(prepare(RawScan(points, normals), 0), points, normals)[1] == 0


def test_given_normals_of_random_sign_are_turned_one_by_one() -> None:
    points, normals = shaft_points(3000)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (3000, 1))
    assert errors(prepare(RawScan(points, signs * normals), 0), points, normals)[1] < 0.002


def test_missing_ones_among_given_normals_come_from_a_neighbour() -> None:
    points, normals = shaft_points(3000)
    holes = normals.copy()
    holes[::50], holes[1::50] = 0, np.nan
    angle, wrong = errors(prepare(RawScan(points, holes), 0), points, normals)
    assert angle < 2 and wrong < 0.001


def test_noise_of_a_paraboloid_is_zero() -> None:
    x, y = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 2000))
    points = np.column_stack([x, y, x**2 - y**2 / 2])
    normals = np.column_stack([-2 * x, y, np.ones(2000)])
    assert noise_level(points, normals / np.linalg.norm(normals, axis=1, keepdims=True)) < 1e-4
