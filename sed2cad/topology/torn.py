"""Strips that a proxy mesh tears: the faces on both sides meet over the gap, and a chamfer or a step ends there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.segmentation.strips import STRIP, extent, widest_gap
from sed2cad.topology.chains import border_of, cycles, pieces
from sed2cad.topology.labelling import Adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.regions import connected

_BETWEEN = 0.75  # widths: so near to the strip's surface lies the border that it was torn at


@dataclass(frozen=True)
class Strip:
    """How long and how wide the regions of a label are if they are strips."""

    length: float
    width: float

    @classmethod
    def of(cls, mesh: Mesh, near: Adjacency, labels: Labels, label: int) -> Strip:
        """Its two long sides are nearly all of its border."""
        own = labels == label
        length = float(near.length[own[near.pairs[:, 0]] != own[near.pairs[:, 1]]].sum()) / 2
        area = float(mesh.face_normals()[1][own].sum())
        return cls(length, area / max(length, 1e-300))


def strips_closed(scan: Scan, fitted: Sequence[FittedPatch], mesh: Mesh, near: Adjacency, labels: Labels) -> Labels:
    """Labels (f,) in which a strip goes on along each border that begins and ends at it, if chance leaves such a gap
    between its points and something is left of the faces on both sides."""
    region = connected(labels, near)[1]
    border = border_of(mesh, region)
    found = labels.copy()
    for piece in (piece for cycle in cycles(border) for piece in pieces(border, cycle)):
        triangles = piece[0] // 3, int(border.twin[piece[0]]) // 3
        left, right = (int(labels[triangle]) for triangle in triangles)
        if not border.at_corner(piece[0]) or left >= right:
            continue
        vertices = np.array([*map(border.origin, piece), border.origin(int(border.twin[piece[-1]]))])
        label = _at_both_ends(mesh, labels, (left, right), vertices)
        if label >= 0 and _goes_on(scan, fitted[label], Strip.of(mesh, near, labels, label), mesh.vertices[vertices]):
            around = np.isin(mesh.faces, vertices).any(axis=1)
            sides = [region == region[triangle] for triangle in triangles]
            if all((own & ~around).any() for own in sides):
                found[around & (sides[0] | sides[1])] = label
    return found


def _at_both_ends(mesh: Mesh, labels: Labels, sides: tuple[int, int], vertices: Labels) -> int:
    """The only label beside those of the sides at both ends of a border; -1 where there is none."""
    at_ends = [np.unique(labels[(mesh.faces == end).any(axis=1)]) for end in vertices[[0, -1]]]
    first, last = (np.setdiff1d(labels_there, sides) for labels_there in at_ends)
    return int(first[0]) if len(first) == 1 and np.array_equal(first, last) else -1


def _goes_on(scan: Scan, patch: FittedPatch, strip: Strip, points: Array) -> bool:
    """Whether the border, points (n, 3), is a gap in a strip."""
    count = len(patch.patch.indices)
    if count == 0 or patch.primitive.freeform or strip.length < STRIP * scan.spacing * count:
        return False
    off = float(np.median(np.abs(patch.primitive.distance(points))))
    return off < _BETWEEN * strip.width and extent(points) < widest_gap(strip.length, count)
