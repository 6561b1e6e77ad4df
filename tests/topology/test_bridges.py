"""Narrow faces that a coarse mesh tears apart."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.plane import Plane
from sed2cad.scan.scan import Frame, Mesh, Scan
from sed2cad.topology.bridges import bridged_labels
from sed2cad.topology.labelling import adjacency
from sed2cad.topology.regions import connected

X, Y, Z = np.eye(3)
SPACING = 0.02


def ribbon(count: int = 40) -> Mesh:
    """A flat mesh of four rows of triangles over [0, 1] x [-0.04, 0.04]."""
    x, y = np.meshgrid(np.linspace(0, 1, count), [-0.04, -0.005, 0.005, 0.04], indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (4 * np.arange(count - 1)[:, None] + np.arange(3)).ravel()
    faces = [np.column_stack([corner, corner + 4, corner + 5]), np.column_stack([corner, corner + 5, corner + 1])]
    return Mesh(vertices, np.vstack(faces))


def torn(mesh: Mesh, gap: float) -> np.ndarray:
    """Labels: sides (0, 2) and a strip (1) along the middle, which the sides cover over a gap in the middle of it."""
    x, y, _ = mesh.centroids().T
    strip = (np.abs(y) < 0.005) & (np.abs(x - 0.5) > gap / 2)
    return np.where(strip, 1, np.where(y > 0, 2, 0))


def patches(points: np.ndarray) -> tuple[Scan, list[FittedPatch]]:
    """The strip stands on the plane y = 0 and has the given points; the sides have none."""
    scan = Scan(points, np.tile(Y, (len(points), 1)), None, Frame(np.zeros(3), 1.0), 0.0, SPACING)

    def fitted(surface: Primitive, own: np.ndarray) -> FittedPatch:
        patch = Patch(own, "plane", np.ones(len(own), bool))
        return FittedPatch(patch, surface, 1, 0.0, np.zeros((3, 3)))

    nothing = np.zeros(0, np.int64)
    sides = [fitted(Plane(Z, 0.0), nothing) for _ in range(2)]
    return scan, [sides[0], fitted(Plane(Y, 0.0), np.arange(len(points))), sides[1]]


def along(count: int) -> np.ndarray:
    return np.linspace(0, 1, count)[:, None] * X


def pieces(mesh: Mesh, labels: np.ndarray) -> int:
    _, region = connected(labels, adjacency(mesh))
    return len(np.unique(region[labels == 1]))


@pytest.mark.parametrize(("count", "gap", "left"), [(40, 0.1, 1), (400, 0.1, 2), (8, 0.4, 1)])
def test_a_strip_hangs_together_over_gaps_that_chance_leaves(count: int, gap: float, left: int) -> None:
    mesh = ribbon()
    labels = torn(mesh, gap)
    assert pieces(mesh, labels) == 2
    scan, fitted = patches(along(count))
    found = bridged_labels(scan, fitted, mesh, adjacency(mesh), labels)
    assert pieces(mesh, found) == left
    assert (found == labels)[labels == 1].all()


def test_what_lies_off_the_surface_is_no_bridge() -> None:
    mesh = ribbon()
    labels = torn(mesh, 0.1)
    bent = mesh.vertices + np.where(np.abs(mesh.vertices[:, :1] - 0.5) < 0.03, SPACING, 0.0) * Y
    bent = Mesh(bent, mesh.faces)
    scan, fitted = patches(along(40))
    assert (bridged_labels(scan, fitted, bent, adjacency(bent), labels) == labels).all()
