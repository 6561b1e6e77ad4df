"""A cap is one piece of its face, and leaves one."""

from __future__ import annotations

import numpy as np

from sed2cad.scan.scan import Mesh
from sed2cad.topology.caps import _in_one
from sed2cad.topology.labelling import adjacency


def strip(columns: int, rows: int) -> tuple[Mesh, np.ndarray]:
    """A flat grid of triangle pairs, and the column and row (f, 2) of each triangle."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    cells = np.array([(i, j) for i in range(columns) for j in range(rows)])
    first = cells[:, 0] * (rows + 1) + cells[:, 1]
    lower = np.column_stack([first, first + rows + 1, first + rows + 2])
    upper = np.column_stack([first, first + rows + 2, first + 1])
    return Mesh(vertices, np.vstack([lower, upper])), np.vstack([cells, cells])


def test_specks_and_holes_are_evened_out() -> None:
    mesh, cells = strip(8, 10)
    inside = cells[:, 1] > 0  # the lowest row is another face
    beyond = cells[:, 1] > 6
    hole = (cells == (4, 8)).all(axis=1)
    speck = (cells == (2, 3)).all(axis=1)
    cap = _in_one(adjacency(mesh), inside, np.flatnonzero((beyond & ~hole) | speck))
    assert np.array_equal(cap, np.flatnonzero(beyond))
