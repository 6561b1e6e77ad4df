"""Which primitive each triangle of the proxy lies on: alpha-expansion on data, votes and creases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.segmentation.corners import EXACT, Corners
from sed2cad.topology.manifold import half_edges, nearest_triangles, twins
from sed2cad.topology.mincut import Labels, Pairs, alpha_expansion

_NEAR = 16  # points around a triangle whose patches are its candidates
_VOTERS = 6  # of them vote
_FITS = 1.0  # units of distance: triangles nearer than this to a primitive may be on it without such points,
_ALIGNED = 0.8  # if their normals agree (cosine)
_FAR = 16.0  # and a point of its patch is within so many spacings
_MISSED = 2.0  # cost of a triangle whose vertices are not on a surface that others' are exactly on
_CREASE = 0.03  # 1 - cosine at which an edge counts as a crease


@dataclass(frozen=True)
class Adjacency:
    """Pairs of triangles with a common edge."""

    pairs: Pairs  # (e, 2)
    length: Array  # (e,) of the edge
    bend: Array  # (e,) 1 - cosine between the normals


def adjacency(mesh: Mesh) -> Adjacency:
    """The pairs of neighbours in a closed manifold mesh."""
    twin = twins(mesh.faces)
    half = np.flatnonzero(twin > np.arange(len(twin)))
    origin, target = half_edges(mesh.faces)
    length = np.linalg.norm(mesh.vertices[target[half]] - mesh.vertices[origin[half]], axis=1)
    pairs = np.column_stack([half // 3, twin[half] // 3])
    normals, _ = mesh.face_normals()
    bend = 1 - np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    return Adjacency(pairs, length, np.clip(bend, 0.0, 2.0))


def data_costs(mesh: Mesh, scan: Scan, fitted: Sequence[FittedPatch], labels: Labels) -> Array:
    """Cost (f, k) of each triangle on each primitive; inf where it is no candidate.

    labels (n,): the patch of each point, -1 for none. Candidates are named by near points; a primitive that
    fits a triangle well may have its points somewhat farther off, so that narrow faces hang together. One that
    the vertices of a mesh lie on costs more where they do not.
    """
    centres, (normals, _) = mesh.centroids(), mesh.face_normals()
    named = labels >= 0
    points, names = scan.points[named], labels[named]
    _, near = cKDTree(points).query(centres, k=min(_NEAR, len(points)), workers=-1)
    around = names[near.reshape(len(centres), -1)]
    vertices = _exact_vertices(scan, centres)
    unit = 2 * scan.noise + 0.3 * scan.spacing
    costs = np.full((len(centres), len(fitted)), np.inf)
    for label, patch in enumerate(fitted):
        own = points[names == label]
        if len(own) == 0:
            continue
        corners = np.abs(patch.primitive.distance(mesh.vertices)) / (unit + patch.rms)
        distance = corners[mesh.faces].mean(axis=1)
        votes = (around == label).sum(axis=1)
        at = np.flatnonzero((votes > 0) | (distance < _FITS))
        cosine = patch.sign * np.einsum("ij,ij->i", patch.primitive.normal(centres[at]), normals[at])
        away, _ = cKDTree(own).query(centres[at], distance_upper_bound=_FAR * scan.spacing)
        candidate = (votes[at] > 0) | ((cosine > _ALIGNED) & np.isfinite(away))
        at, cosine = at[candidate], cosine[candidate]
        share = (around[at, :_VOTERS] == label).mean(axis=1)
        costs[at, label] = np.minimum(distance[at], 4.0) + 3 * (1 - cosine) + 1.5 * (1 - share)
        if vertices is not None and vertices[0][np.flatnonzero(labels == label)].settle(patch.primitive):
            costs[at[~vertices[1][at].on(patch.primitive)], label] += _MISSED
    return costs


def _exact_vertices(scan: Scan, centres: Array) -> tuple[Corners, Corners] | None:
    """What a CAD system's mesh knows of the points of a scan and of the triangles (f, 3) of a proxy that divides it."""
    corners, mesh = Corners.of(scan), scan.mesh
    if corners is None or mesh is None:
        return None
    distance, on = nearest_triangles(mesh, centres)
    if np.median(distance) > EXACT:  # another proxy
        return None
    return corners, Corners.of_triangles(mesh, on)


def label_triangles(mesh: Mesh, near: Adjacency, costs: Array, smoothness: float = 1.0) -> Labels:
    """Labels (f,): data weighted by area, borders by length, cheaper along creases."""
    _, area = mesh.face_normals()
    share = np.clip(area / max(float(np.median(area)), 1e-300), 0.05, 20.0)
    typical = max(float(np.median(near.length)), 1e-300)
    smooth = 0.3 + 0.7 * np.exp(-near.bend / _CREASE)
    weights = smoothness * np.clip(near.length / typical, 0.05, 20.0) * smooth
    return alpha_expansion(costs * share[:, None], near.pairs, weights)
