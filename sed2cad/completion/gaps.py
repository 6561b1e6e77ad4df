"""Gaps: where the proxy closes over a part of the surface that the scan does not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.primitives.vectors import unit
from sed2cad.scan.neighbours import nearest
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.labelling import adjacency

_AROUND = 8  # points whose distance says how far apart points lie somewhere
_COARSE = 1.6  # edges of the proxy, where it is coarser than the points: as far apart as points would lie
_FAR = 1.5  # times that distance: a triangle's centre so far from all points lies in a gap,
_LONG = 2.0  # and with it the triangles beside it that have an edge so long
_TURN = 1.3  # of it: how far away an opposite normal puts a point, half of that; a bevel's two faces remain beside it
_WIDE = 4.0  # times it: mean width of a gap with points of other faces near by; a strip around a plate has thrice its
_LEAST = 3.0  # times it: the radius of a gap; what is smaller, chance may leave, and the proxy closes,
_BESIDE = 1.5  # but within a larger one less will do
_WIDER = 1.5  # radii of a gap's ball in which surfaces are extended
_ACROSS = 60  # samples from the middle of a gap to its rim, no more


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
        """Of a square grid as dense as the points beside the gap: half a disc around a rim point holds its nearest.

        Coarser where the gap is wide.
        """
        return max(self.reach * float(np.sqrt(np.pi / (2 * _AROUND))), self.radius / _ACROSS)

    @property
    def is_large(self) -> bool:
        """Whether it is none that chance may leave."""
        return self.radius > _LEAST * self.reach

    @property
    def around(self) -> float:
        """Radius of the ball around the centre in which surfaces may go on."""
        return _WIDER * self.radius

    def is_around(self, other: Gap) -> bool:
        """Whether another gap lies where the surfaces around this one may go on."""
        return float(np.linalg.norm(self.centre - other.centre)) + other.radius < self.around


def find_gaps(scan: Scan, mesh: Mesh) -> list[Gap]:
    """The gaps of a scan in a proxy whose vertices lie near its points, the largest first.

    There no point is near, or only points of faces that look elsewhere: the other side of a plate.
    """
    distance, _ = nearest(scan.points, _AROUND)
    edges = mesh.edge_lengths()
    apart = np.maximum(distance[:, -1], _COARSE * float(np.median(edges)))
    tree = cKDTree(scan.points)
    alone, empty = _empty(scan, tree, mesh, apart)
    _, corner = tree.query(mesh.vertices)
    near = adjacency(mesh).pairs
    beside = np.zeros(len(mesh.faces), dtype=bool)
    beside[near[empty[near].any(axis=1)]] = True
    open_ = empty | (beside & (edges.max(axis=1) > _LONG * apart[corner[mesh.faces]].max(axis=1)))
    _, group = components(len(mesh.faces), near[open_[near].all(axis=1)])
    normals, areas = mesh.face_normals()
    found: list[Gap] = []
    for own in (group == one for one in np.unique(group[empty])):
        rim = np.unique(corner[np.intersect1d(mesh.faces[own], mesh.faces[~own])])
        if len(rim) == 0:
            continue
        gap = _gap(scan, rim, apart, areas[own] @ normals[own])
        wide = alone[own].any() or areas[own].sum() > _WIDE * gap.reach * 2 * gap.radius
        if wide and gap.radius > _BESIDE * gap.reach:
            found.append(gap)
    return sorted(found, key=lambda gap: -gap.radius)


def _empty(scan: Scan, tree: cKDTree, mesh: Mesh, apart: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which triangles (t,) have no point near, and which have none that looks the same way.

    tree: of the scan's points; apart (n,): how far the neighbours of each of them are.
    """
    centres, (normals, _) = mesh.centroids(), mesh.face_normals()
    off, at = tree.query(centres, workers=-1)
    turn = _TURN * float(np.median(apart))
    alike = cKDTree(np.hstack([scan.points, turn * scan.normals]))
    turned, _ = alike.query(np.hstack([centres, turn * normals]), workers=-1)
    return off > _FAR * apart[at], turned > _FAR * apart[at]


def joined(gaps: Sequence[Gap]) -> list[Gap]:
    """Gaps, the largest first, each with those around it: a bore that was looked into ends at the unseen side too."""
    found: list[Gap] = []
    for gap in gaps:
        around = [k for k, other in enumerate(found) if other.is_around(gap)]
        if around:
            other = found[around[0]]
            found[around[0]] = replace(other, rim=np.union1d(other.rim, gap.rim))
        elif gap.is_large:
            found.append(gap)
    return found


def _gap(scan: Scan, rim: NDArray[np.int64], apart: Array, outwards: Array) -> Gap:
    """That between points; apart (n,): how far the neighbours of each point of the scan are."""
    points = scan.points[rim]
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    return Gap(rim, float(np.median(apart[rim])), centre, radius, unit(outwards))
