"""Gaps: where the proxy closes over a part of the surface that the scan does not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.scan.neighbours import nearest
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.labelling import adjacency

_AROUND = 8  # points whose distance says how far apart points lie somewhere
_FAR = 1.5  # times that distance: a triangle's centre so far from all points lies in a gap,
_LONG = 2.0  # and with it the triangles beside it that have an edge so long

_LEAST = 3.0  # times it: the radius of a gap; what is smaller, chance may leave, and the proxy closes


@dataclass(frozen=True)
class Gap:
    """A connected part of the proxy without points."""

    rim: NDArray[np.int64]  # (m,) indices of the scan's points around it
    reach: float  # how far apart points lie there
    centre: Array  # (3,)
    radius: float  # of the ball around the centre that holds the rim
    outwards: Array  # (3,) mean outward normal of the proxy in it

    @property
    def spacing(self) -> float:
        """Of a square grid as dense as the points beside the gap: half a disc around a rim point holds its nearest."""
        return self.reach * float(np.sqrt(np.pi / (2 * _AROUND)))


def find_gaps(scan: Scan, mesh: Mesh) -> list[Gap]:
    """The gaps of a scan in a proxy whose vertices lie near its points."""
    distance, _ = nearest(scan.points, _AROUND)
    apart = distance[:, -1]
    tree = cKDTree(scan.points)
    off, at = tree.query(mesh.centroids())
    _, corner = tree.query(mesh.vertices)
    edges = np.linalg.norm(mesh.vertices[np.roll(mesh.faces, -1, axis=1)] - mesh.vertices[mesh.faces], axis=2)
    empty = off > _FAR * apart[at]
    open_ = empty | (edges.max(axis=1) > _LONG * apart[corner[mesh.faces]].max(axis=1))
    near = adjacency(mesh).pairs
    _, group = components(len(mesh.faces), near[open_[near].all(axis=1)])
    normals, areas = mesh.face_normals()
    gaps = []
    for one in np.unique(group[empty]).tolist():
        own = group == one
        rim = np.unique(corner[mesh.faces[own]])
        points = scan.points[rim]
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = float(np.linalg.norm(points - centre, axis=1).max())
        outwards = areas[own] @ normals[own]
        if radius < _LEAST * float(np.median(apart[rim])):
            continue
        gaps.append(Gap(rim, float(np.median(apart[rim])), centre, radius, outwards / np.linalg.norm(outwards)))
    return gaps
