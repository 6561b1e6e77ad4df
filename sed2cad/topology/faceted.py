"""Fewer triangles, still closed and manifold: the last resort of the assembly."""

from __future__ import annotations

import gpytoolbox
import numpy as np

from sed2cad.scan.scan import Mesh
from sed2cad.topology.manifold import euler_number, is_closed_manifold, used

_LARGEST_CHANGE = 0.05  # of the volume


def decimate(mesh: Mesh, faces: int = 1500) -> Mesh:
    """The mesh with about `faces` triangles (quadric error, Garland and Heckbert 1997), of the same topology.

    Collapses that would break the manifold are not made. If the result is not good enough, more triangles are
    kept; a mesh that is small already comes back unchanged.
    """
    while faces < len(mesh.faces):
        fewer = _collapsed(mesh, faces)
        if _as_good(fewer, mesh):
            return fewer
        faces *= 2
    return mesh


def _collapsed(mesh: Mesh, faces: int) -> Mesh:
    """libigl's quadric decimation."""
    vertices, triangles, _, _ = gpytoolbox.decimate(
        mesh.vertices, mesh.faces.astype(np.int32), num_faces=faces, method="qslim"
    )
    return used(Mesh(np.asarray(vertices, dtype=float), np.asarray(triangles, dtype=np.int64)))


def _as_good(fewer: Mesh, mesh: Mesh) -> bool:
    """Whether the decimated mesh is closed, of the same Euler number and about the same volume."""
    if len(fewer.faces) == 0 or not np.isfinite(fewer.vertices).all() or not is_closed_manifold(fewer.faces):
        return False
    same = euler_number(fewer.faces) == euler_number(mesh.faces)
    return same and abs(fewer.volume() - mesh.volume()) < _LARGEST_CHANGE * abs(mesh.volume())
