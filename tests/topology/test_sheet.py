"""A sheet's front is what the scan shows, and ends where it does."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.errors import AssemblyError
from sed2cad.topology.manifold import euler_number, is_closed_manifold
from sed2cad.topology.sheet import sheet_of
from tests.completion.scans import on_a_table, seen
from tests.topology.scans import Piece, Z, box, rectangle, ring, scan_of, sphere, wall

FLAT, RAISED = np.array([0.6, 0.5, 0.0]), np.array([0.6, 0.5, 0.5])


@pytest.mark.parametrize(
    ("pieces", "area", "euler"),
    [
        ([rectangle(2, 1, FLAT)], 0.3, 2),
        ([ring(0.15, 0.35, 0.0, 1)], np.pi * 0.1, 0),  # a thin ring
        ([wall(0.3, -0.2, 0.2)], np.pi * 0.24, 0),  # a thin tube
        ([rectangle(2, 1, FLAT), rectangle(2, 1, RAISED)], 0.6, 4),  # two plates
    ],
)
def test_the_front_is_the_surface_that_the_scan_shows(pieces: list[Piece], area: float, euler: int) -> None:
    scan, fitted = scan_of(pieces)
    sheet = sheet_of(scan, fitted)
    assert is_closed_manifold(sheet.mesh.faces) and euler_number(sheet.mesh.faces) == euler
    normals, areas = sheet.mesh.face_normals()
    front = np.ones(len(areas), dtype=bool)
    front[sheet.back] = False
    assert areas[front].sum() == pytest.approx(area, rel=0.05)
    centres = sheet.mesh.centroids()[front]
    off = np.array([np.abs(patch.primitive.distance(centres)) for patch in fitted]).min(axis=0)
    assert off.max() < scan.spacing
    outwards = np.array([patch.sign * patch.primitive.normal(centres) for patch in fitted])
    assert (np.einsum("kij,ij->ki", outwards, normals[front]).max(axis=0) > 0.9).mean() > 0.99


def test_an_edge_is_on_the_front() -> None:
    """Below it the copies of one face come near the other."""
    scan, fitted = on_a_table(*scan_of(box()))
    sheet = sheet_of(scan, fitted)
    front = np.setdiff1d(np.arange(len(sheet.mesh.faces)), sheet.back)
    _, areas = sheet.mesh.face_normals()
    assert areas[front].sum() == pytest.approx(0.7 * 0.5 + 2 * (0.7 + 0.5) * 0.4, rel=0.05)
    assert (sheet.mesh.centroids()[front] @ Z).min() == pytest.approx(-0.2, abs=3 * scan.spacing)


def test_through_points_too_far_apart_there_is_none() -> None:
    scan, fitted = seen(*scan_of(sphere()), np.arange(5000) < 40)
    with pytest.raises(AssemblyError, match="sheet"):
        sheet_of(scan, fitted)
