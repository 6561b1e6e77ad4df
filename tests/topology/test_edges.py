"""Samples on edges: where few points tell of them, and where something interrupts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.plane import Plane
from sed2cad.scan.scan import Array, Frame, Scan
from sed2cad.topology.edges import surface_samples
from tests.topology import scans

OUTER, UPPER, FLOOR, LOWER = 1, 2, 3, 4  # patches of the grooved cylinder


def grooved(bare: float) -> tuple[Scan, list[FittedPatch]]:
    """A cylinder with a groove two spacings wide, of which the scan shows nothing on `bare` radians of the turn."""
    radius, depth, low, high = 0.35, 0.014, -0.01, 0.01
    pieces = [
        scans.ring(0.0, radius, -0.2, -1),
        scans.wall(radius, -0.2, 0.2),
        scans.ring(radius - depth, radius, low, 1),
        scans.wall(radius - depth, low, high),
        scans.ring(radius - depth, radius, high, -1),
        scans.ring(0.0, radius, 0.2, 1),
    ]
    scan, fitted = scans.scan_of(pieces, 6000)
    outside = scan.points[fitted[OUTER].patch.indices, 2]
    out = [*fitted]
    out[OUTER] = _of(fitted[OUTER], fitted[OUTER].patch.indices[(outside < low) | (outside > high)])
    for k in (UPPER, FLOOR, LOWER):
        x, y, _ = scan.points[fitted[k].patch.indices].T
        out[k] = _of(fitted[k], fitted[k].patch.indices[np.abs(np.arctan2(y, x)) > bare / 2])
    return _seen(scan, out)


def _of(patch: FittedPatch, indices: np.ndarray) -> FittedPatch:
    own = Patch(indices, patch.patch.kind, np.ones(len(indices), bool))
    return replace(patch, patch=own)


def _seen(scan: Scan, fitted: list[FittedPatch]) -> tuple[Scan, list[FittedPatch]]:
    """The points of the patches alone."""
    kept = np.concatenate([patch.patch.indices for patch in fitted])
    ends = np.cumsum([0, *(len(patch.patch.indices) for patch in fitted)])
    again = [_of(patch, np.arange(a, b)) for patch, a, b in zip(fitted, ends, ends[1:])]
    return Scan(scan.points[kept], scan.normals[kept], None, scan.frame, 0.0, scan.spacing), again


def widest(scan: Scan, fitted: list[FittedPatch], one: int, two: int) -> float:
    """The widest gap of the samples on a circular edge, in spacings."""
    samples = surface_samples(scan, fitted)
    own = samples.points[(np.sort(samples.labels, axis=1) == sorted((one, two))).all(axis=1)]
    angle = np.sort(np.arctan2(own[:, 1], own[:, 0]))
    gap = np.diff(np.r_[angle, angle[0] + 2 * np.pi]).max()
    return float(gap * np.linalg.norm(own[0, :2]) / scan.spacing)


def test_the_edges_of_a_groove_go_all_the_way_around() -> None:
    scan, fitted = grooved(0.2)
    assert 8 * scan.spacing < 0.2 * 0.35
    for one, two in ((OUTER, UPPER), (UPPER, FLOOR), (FLOOR, LOWER), (LOWER, OUTER)):
        assert widest(scan, fitted, one, two) < 2.5


def test_a_groove_that_ends_has_no_edges_beyond() -> None:
    scan, fitted = grooved(1.0)
    assert widest(scan, fitted, UPPER, FLOOR) > 20


def corner_with_block(size: float) -> tuple[Scan, list[FittedPatch]]:
    """A floor and a wall, and a block on the edge between them."""
    rng = np.random.default_rng(0)
    span, count = 0.3, 9_000

    def sheet(normal: Array, offset: float, axes: tuple[int, int], low: Array, high: Array) -> tuple[Plane, Array]:
        points = np.zeros((round(count * np.prod(np.array(high) - low) / span**2), 3))
        points[:, axes] = rng.uniform(low, high, (len(points), 2))
        return Plane(normal, offset), points + offset * np.asarray(normal)

    x, y, z = np.eye(3)
    half = size / 2
    sheets = [
        sheet(z, 0.0, (0, 1), np.array([0, -span]), np.array([span, span])),
        sheet(x, 0.0, (1, 2), np.array([-span, 0]), np.array([span, span])),
        sheet(x, size, (1, 2), np.array([-half, 0]), np.array([half, size])),
        sheet(z, size, (0, 1), np.array([0, -half]), np.array([size, half])),
        sheet(y, half, (0, 2), np.array([0, 0]), np.array([size, size])),
        sheet(-y, half, (0, 2), np.array([0, 0]), np.array([size, size])),
    ]
    points, normals, fitted, first = [], [], [], 0
    for plane, at in sheets:
        inside = (np.abs(at[:, 1]) < half) & (at[:, 0] < size) & (at[:, 2] < size) & (len(fitted) < 2)
        at = at[~inside]
        points.append(at)
        normals.append(np.broadcast_to(plane.normal_vector, at.shape))
        indices = np.arange(first, first + len(at))
        fitted.append(FittedPatch(Patch(indices, "plane", np.ones(len(at), bool)), plane, 1, 0.0, 1e-12 * np.eye(3)))
        first += len(at)
    spacing = 0.5 * span / np.sqrt(count)
    return Scan(np.vstack(points), np.vstack(normals), None, Frame(np.zeros(3), 1.0), 0.0, spacing), fitted


def test_an_edge_that_something_interrupts_stays_in_two_pieces() -> None:
    size = 0.02
    scan, fitted = corner_with_block(size)
    assert 6 < size / scan.spacing < 16
    samples = surface_samples(scan, fitted)
    edge = samples.points[(samples.labels == (0, 1)).all(axis=1)]
    assert len(edge) > 100
    assert np.abs(edge[:, 1]).min() > size / 2 - scan.spacing


def test_surfaces_that_do_not_meet_have_no_edges() -> None:
    scan, fitted = scans.scan_of(scans.sphere(), 500)
    assert not surface_samples(scan, fitted).on_edge.any()
    scan, fitted = corner_with_block(0.02)
    samples = surface_samples(scan, [_of(patch, patch.patch.indices[:3]) for patch in fitted])
    assert len(samples) >= 3
