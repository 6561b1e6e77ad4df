"""Walls thinner than points lie apart: how their faces hang together is read from a part with thicker walls.

All points move outwards, and so do the surfaces: parallel ones bound a part that hangs together alike, but for gaps as
narrow. Its proxy mesh, moved back, has the walls that no mesh through the points themselves would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import FittedPatch, point_labels
from sed2cad.primitives.parallel import parallel
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.labelling import Labels
from sed2cad.topology.trace import Traced, retraced, trace

_BY = 1.5  # spacings: how far faces move
_THIN = 3.0  # spacings: thicker walls need no help
_SHARE = 0.02  # of the points that lie on thin walls: where fewer do there are none
_OPPOSED = -0.9  # cosine of the normals on the two sides of a wall
_FEW = 0.05  # share of the largest eigenvalue: directions in which a vertex does not move


def has_thin_walls(scan: Scan) -> bool:
    """Whether some of the points have others behind them that look the other way."""
    reach = _THIN * scan.spacing
    behind = cKDTree(scan.points).query_pairs(reach, output_type="ndarray")
    i, j = behind[np.einsum("ij,ij->i", scan.normals[behind[:, 0]], scan.normals[behind[:, 1]]) < _OPPOSED].T
    inwards = np.einsum("ij,ij->i", scan.points[j] - scan.points[i], scan.normals[i]) < 0
    thin = np.union1d(i[inwards], j[inwards])
    return len(thin) > _SHARE * len(scan.points)


def traced_thick(scan: Scan, fitted: Sequence[FittedPatch], smoothness: float) -> Traced:
    """The topology of the part with thicker walls, on the given patches. AssemblyError where it has none, or where
    surfaces have no parallel ones."""
    by = _BY * scan.spacing
    wide = trace(*_thickened(scan, fitted, by), smoothness)
    caps = [_moved(patch, -by) for patch in wide.fitted[len(fitted) :]]
    names = np.array([region.primitive for region in wide.topology.regions])[wide.labels]
    mesh = _moved_back(wide.proxy, names, wide.fitted, by)
    return retraced(scan, mesh, [*fitted, *caps], names, wide.caps)


def _thickened(scan: Scan, fitted: Sequence[FittedPatch], by: float) -> tuple[Scan, list[FittedPatch]]:
    """All points and surfaces moved outwards."""
    outwards, owner = scan.normals.copy(), point_labels(len(scan.points), fitted)
    for number, patch in enumerate(fitted):
        own = owner == number
        outwards[own] = patch.sign * patch.primitive.normal(scan.points[own])
    points = scan.points + by * outwards
    moved = replace(scan, points=points, normals=outwards, mesh=None, part=None, triangle=None)
    return moved, [_moved(patch, by) for patch in fitted]


def _moved(patch: FittedPatch, by: float) -> FittedPatch:
    """A patch moved outwards. AssemblyError where its surface has no parallel one."""
    surface = parallel(patch.primitive, patch.sign * by)
    if surface is None:
        raise AssemblyError(f"a {patch.primitive.kind} has no parallel surface to read thin walls from")
    return replace(patch, primitive=surface)


def _moved_back(mesh: Mesh, labels: Labels, fitted: Sequence[FittedPatch], by: float) -> Mesh:
    """The mesh moved inwards: each vertex along the normals of the surfaces (f,) about it, by as much along each (least
    squares)."""
    pairs = np.unique(np.column_stack([mesh.faces.ravel(), np.repeat(labels, 3)]), axis=0)
    normals = np.zeros((len(pairs), 3))
    for label in np.unique(labels).tolist():
        own = pairs[:, 1] == label
        normals[own] = fitted[label].sign * fitted[label].primitive.normal(mesh.vertices[pairs[own, 0]])
    products, sums = np.zeros((len(mesh.vertices), 3, 3)), np.zeros((len(mesh.vertices), 3))
    np.add.at(products, pairs[:, 0], normals[:, :, None] * normals[:, None, :])
    np.add.at(sums, pairs[:, 0], normals)
    moves: Array = np.einsum("nij,nj->ni", np.linalg.pinv(products, rcond=_FEW, hermitian=True), sums)
    return Mesh(mesh.vertices - by * moves, mesh.faces)
