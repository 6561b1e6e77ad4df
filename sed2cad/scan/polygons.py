"""Polygons of any number of corners to triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.errors import ScanError
from sed2cad.scan.scan import Array, Mesh


def polygon_mesh(vertices: Array, lengths: NDArray, corners: NDArray, name: str) -> Mesh:
    """Fans of triangles from polygons given by their lengths (f,) and all their corners in one array."""
    lengths, corners = lengths.astype(np.int64), corners.astype(np.int64)
    if len(corners) and not (0 <= corners.min() and corners.max() < len(vertices)):
        raise ScanError(f"{name}: a face names a vertex that is not in the file; export the mesh again")
    first = np.cumsum(lengths) - lengths
    triangles = np.maximum(lengths - 2, 0)
    at = np.repeat(first, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return Mesh(vertices, np.column_stack([corners[at], corners[at + step + 1], corners[at + step + 2]]))
