"""Is there anything to reconstruct in the scan?"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from sed2cad.errors import ScanError
from sed2cad.scan.local_fits import TWO_SHEETS
from sed2cad.scan.raw import RawScan, ScanWarning
from sed2cad.scan.scan import Array, Mesh

FEWEST = 50
"""Points that a scan must have."""
MOST_BAD = 0.01
"""Share of points with NaN or inf that may be dropped."""
FLAT = 1e-4
"""Thickness in units of the diagonal below which points lie on a plane or a line,"""
NOISY = 6.0
"""and in units of the noise: a noisy plane has 3.5."""


def clean_points(raw: RawScan) -> tuple[Array, Array | None]:
    """Finite, distinct points (n, 3) in an order that the file's order has no influence on, and their
    normals.

    ScanError when too many are not finite, too few remain, or all lie on a plane or a line.
    """
    finite = _finite(raw)
    points = raw.points[finite]
    normals = None if raw.normals is None else raw.normals[finite]
    if len(points) < FEWEST:
        raise ScanError(f"{raw.name}: only {len(points)} points, a scan needs {FEWEST}; scan the part denser")
    order = np.lexsort(points.T)
    new = np.r_[True, (np.diff(points[order], axis=0) != 0).any(axis=1)]
    first = order[new]
    if len(first) < FEWEST:
        raise ScanError(
            f"{raw.name}: only {len(first)} of its {len(points)} points are distinct, a scan needs {FEWEST}; "
            "export it again"
        )
    if len(first) < len(points):
        removed = len(points) - len(first)
        warnings.warn(f"{raw.name}: {removed} duplicate points removed", ScanWarning, stacklevel=3)
    require_depth(points[first], raw.name)
    return points[first], None if normals is None else normals[first]


def clean_mesh(raw: RawScan, mesh: Mesh) -> Mesh:
    """The mesh without triangles at vertices that are not finite; ScanError as for points."""
    finite = _finite(raw)
    faces = mesh.faces[finite[mesh.faces].all(axis=1)]
    used = mesh.vertices[np.unique(faces)]
    if len(used) < 4:
        raise ScanError(f"{raw.name}: only {len(faces)} triangles; that is no solid, export the mesh again")
    require_depth(used, raw.name)
    return Mesh(np.where(finite[:, None], mesh.vertices, 0.0), faces)


def require_depth(points: Array, name: str, noise: float = 0.0) -> None:
    """ScanError when the points (n, 3) are thinner than FLAT times their diagonal, or as thin as noise.

    Thickness is that of an even slab with the same standard deviation, which single outliers change little.
    Points in two sheets are a thin plate, not a noisy plane.
    """
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2][::-1]  # thinnest direction first
    local = centred @ axes.T
    width = local.std(axis=0) * np.sqrt(12)
    two_sheets = (local[:, 0] ** 4).mean() < TWO_SHEETS * local[:, 0].var() ** 2
    limit = max(FLAT * float(np.linalg.norm(width)), 0.0 if two_sheets else NOISY * noise)
    for extent, shape in zip(width[::-1], ("in one place", "on one line", "on one plane")):
        if extent <= limit:
            raise ScanError(f"{name}: all points lie {shape}; scan the part from all sides")


def _finite(raw: RawScan) -> NDArray[np.bool_]:
    finite = np.asarray(np.isfinite(raw.points).all(axis=1))
    bad, count = int((~finite).sum()), len(raw.points)
    if bad > MOST_BAD * count:
        raise ScanError(f"{raw.name}: {bad} of {count} points are NaN or infinite; export it without them")
    if bad:
        warnings.warn(f"{raw.name}: {bad} points with NaN or infinity dropped", ScanWarning, stacklevel=4)
    return finite
