"""Strips between two heights that a proxy mesh tears: the faces on both sides meet, and no edge can lie on both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.segmentation.strips import extent, widest_gap
from sed2cad.topology.chains import border_of, cycles, pieces
from sed2cad.topology.labelling import Adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.regions import connected
from sed2cad.topology.walls import rise_at

_BETWEEN = 0.75  # heights: so near to the strip's surface lies the border that it was torn at


def strips_closed(scan: Scan, fitted: Sequence[FittedPatch], mesh: Mesh, near: Adjacency, labels: Labels) -> Labels:
    """Labels (f,) in which a strip goes on along each border that begins and ends at it, if the two faces there lie at
    different heights and chance leaves such a gap between its points."""
    region = connected(labels, near)[1]
    border = border_of(mesh, region)
    found = labels.copy()
    for piece in (piece for cycle in cycles(border) for piece in pieces(border, cycle)):
        triangles = piece[0] // 3, int(border.twin[piece[0]]) // 3
        left, right = (int(labels[triangle]) for triangle in triangles)
        if not border.at_corner(piece[0]) or left >= right:
            continue
        vertices = np.array([*map(border.origin, piece), border.origin(int(border.twin[piece[-1]]))])
        points = mesh.vertices[vertices]
        rise = abs(rise_at(scan, fitted[left], fitted[right], points))
        strip = _at_both_ends(mesh, labels, (left, right), vertices) if rise else -1
        if strip >= 0 and _goes_on(scan, fitted[strip], rise, points):
            around = np.isin(mesh.faces, vertices).any(axis=1)
            found[around & np.isin(region, region[list(triangles)])] = strip
    return found


def _at_both_ends(mesh: Mesh, labels: Labels, sides: tuple[int, int], vertices: Labels) -> int:
    """The only label beside those of the sides at both ends of a border; -1 where there is none."""
    at_ends = [np.unique(labels[(mesh.faces == end).any(axis=1)]) for end in vertices[[0, -1]]]
    first, last = (np.setdiff1d(labels_there, sides) for labels_there in at_ends)
    return int(first[0]) if len(first) == 1 and np.array_equal(first, last) else -1


def _goes_on(scan: Scan, strip: FittedPatch, rise: float, points: Array) -> bool:
    """Whether the border, points (n, 3), is a gap in a strip."""
    own = scan.points[strip.patch.indices]
    if len(own) == 0 or strip.primitive.freeform:
        return False
    off = float(np.median(np.abs(strip.primitive.distance(points))))
    return off < _BETWEEN * rise and extent(points) < widest_gap(extent(own), len(own))
