"""A second look at the regions after their faces failed: those that a neighbour explains as well join it, and
triangles that their surface does not explain get a plane of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.topology.labelling import Adjacency, adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.trace import Traced, retraced

_SAME = 6e-3  # unit frame: a region this near to a neighbour's surface may join it,
_ALIKE = 0.9  # if their normals agree (cosine)
_TINY = 1e-3  # of the unit area: smaller regions need only be near,
_NEAR = 1e-2  # so near
_ASTRAY = 8e-3  # unit frame: a triangle this far from its surface belongs elsewhere
_TURNED = 0.3  # so does one turned this far (cosine) from it, if it is
_OFF = 1.5e-3  # so far from it
_ACROSS = 0.7  # cosine below which its neighbours do, too
_FLAT = 4e-3  # unit frame: rms of a plane through such triangles
_LEAST = 3  # triangles


def remedied(scan: Scan, traced: Traced, fitted: Sequence[FittedPatch], blamed: Sequence[int]) -> Traced | None:
    """The topology after a second look, on the given patches and some more; None where nothing changes."""
    mesh, near = traced.proxy, adjacency(traced.proxy)
    names = np.array([region.primitive for region in traced.topology.regions])
    labels = names[traced.labels]
    patches = list(fitted)
    before = labels.copy()
    for region in (r for r in blamed if r < len(names)):  # walls that were put in have no triangles
        best = _better(mesh, near, traced, labels, patches, region)
        if best >= 0:
            labels[traced.labels == region] = best
    labels = _unexplained(scan, mesh, near, labels, patches, traced.caps)
    if np.array_equal(labels, before):
        return None
    return retraced(scan, traced.proxy, patches, labels, traced.caps)


def _better(
    mesh: Mesh, near: Adjacency, traced: Traced, labels: Labels, patches: Sequence[FittedPatch], region: int
) -> int:
    """The neighbouring label that explains a region, too; -1: none."""
    inside = traced.labels == region
    border = inside[near.pairs[:, 0]] != inside[near.pairs[:, 1]]
    outer = np.where(inside[near.pairs[border, 0]], near.pairs[border, 1], near.pairs[border, 0])
    centres, (normals, _) = mesh.centroids()[inside], mesh.face_normals()
    tiny = traced.topology.regions[region].area < _TINY
    found = []
    for label in np.setdiff1d(labels[outer], labels[inside]):
        patch = patches[label]
        off = np.abs(patch.primitive.distance(centres))
        cosine = patch.sign * np.einsum("ij,ij->i", patch.primitive.normal(centres), normals[inside])
        alike = np.median(cosine) > _ALIKE and np.quantile(off, 0.95) < _SAME
        if alike or (tiny and off.max() < _NEAR):
            found.append((float(off.mean()), int(label)))
    return min(found)[1] if found else -1


def _unexplained(
    scan: Scan, mesh: Mesh, near: Adjacency, labels: Labels, patches: list[FittedPatch], caps: Sequence[int]
) -> Labels:
    """Labels (f,) in which flat groups of triangles far from their surfaces have a plane, added to `patches`.

    Caps do not follow their triangles: nobody saw them.
    """
    centres, (normals, _) = mesh.centroids(), mesh.face_normals()
    off, cosine = np.zeros(len(labels)), np.ones(len(labels))
    for label in np.unique(labels):
        own, patch = np.flatnonzero(labels == label), patches[label]
        off[own] = np.abs(patch.primitive.distance(centres[own]))
        cosine[own] = patch.sign * np.einsum("ij,ij->i", patch.primitive.normal(centres[own]), normals[own])
    astray = (off > _ASTRAY) | ((cosine < _TURNED) & (off > _OFF))
    seen = ~np.isin(labels, caps)
    seeds, chosen = astray & seen, (astray | (cosine < _ACROSS)) & seen
    both = chosen[near.pairs].all(axis=1)
    _, group = components(len(labels), near.pairs[both])
    labels = labels.copy()
    for which in np.unique(group[seeds]):
        own = np.flatnonzero(group == which)
        plane = _plane(mesh, own)
        if plane is not None:
            labels[own] = len(patches)
            patches.append(_as_patch(scan, plane, centres[own]))
    return labels


def _plane(mesh: Mesh, own: Labels) -> Plane | None:
    """The plane through triangles, looking outwards, where they are flat."""
    centres, (normals, areas) = mesh.centroids()[own], mesh.face_normals()
    if len(own) < _LEAST:
        return None
    mean = areas[own] @ normals[own]
    length = float(np.linalg.norm(mean))
    if length < 0.8 * areas[own].sum():
        return None
    normal = mean / length
    offset = float(areas[own] @ (centres @ normal) / areas[own].sum())
    rms = root_mean_square(centres @ normal - offset)
    return Plane(normal, offset) if rms < _FLAT else None


def _as_patch(scan: Scan, plane: Plane, centres: np.ndarray) -> FittedPatch:
    """The plane as a patch, with the scan's points about the triangles."""
    off, _ = cKDTree(centres).query(scan.points, workers=-1)
    indices = np.flatnonzero((off < scan.spacing) & (np.abs(plane.distance(scan.points)) < _FLAT)).astype(np.int64)
    rms = max(scan.noise, 0.1 * scan.spacing)
    patch = Patch(indices, "plane", np.ones(len(indices), dtype=bool))
    return FittedPatch(patch, plane, 1, rms, rms**2 * np.eye(Plane.freedom))
