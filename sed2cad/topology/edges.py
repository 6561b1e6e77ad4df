"""Samples on the edges between patches, sharp or tangent: where surfaces meet between neighbouring points.

Narrow strips (chamfers, fillets) often have too few points to touch their neighbours everywhere. Where the
edge that two patches would have lies cut off behind a strip between them, the strip's two edges are sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.geometry.contact import Side
from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.neighbours import search_tree
from sed2cad.scan.scan import Array, Scan
from sed2cad.topology.meet import meeting
from sed2cad.topology.samples import Labels, Mask, Samples, face_samples, first_of_each, thinned

_NEIGHBOURS = 12
_REACH = 4.0  # spacings: longer pairs of points are not neighbours
_CELL = 1.0  # spacings: of the samples along an edge
_CLOSE = 0.5  # spacings: face samples this close to an edge give way to it
_STRIP_REACH = 8.0  # spacings: gaps in a strip are bridged up to twice this
_GAP = 16.0  # spacings: the longest gap in an edge that is filled
_WIDE = 1.8  # spacings: the shortest
_OWN_REACH = 3.0  # spacings: so near to a sample that fills a narrow gap lies one of a face
_AROUND = 32  # edge samples around it that tell which patches meet there
_ROUNDS = 6  # each halves the gaps
_CUT_OFF = 0.1  # spacings: how far behind a strip an edge must lie


@dataclass(frozen=True)
class Meetings:
    """Places where two patches seem to meet."""

    points: Array  # (m, 3) between a point of the one and a point of the other
    sides: Labels  # (m, 2) the patches, ascending
    size: Array  # (m,) how far the two points are apart
    convex: Mask  # (m,)

    def __getitem__(self, at: Mask | Labels) -> Meetings:
        return Meetings(self.points[at], self.sides[at], self.size[at], self.convex[at])


def surface_samples(scan: Scan, fitted: Sequence[FittedPatch]) -> Samples:
    """Face samples and edge samples of the scan; face samples close to an edge give way to it."""
    faces = face_samples(scan, fitted)
    edges = edge_samples(faces, fitted, scan.spacing)
    if len(edges) == 0:
        return faces
    distance, _ = cKDTree(edges.points).query(faces.points, workers=-1)
    return faces[distance > _CLOSE * scan.spacing] + edges


def edge_samples(faces: Samples, fitted: Sequence[FittedPatch], spacing: float) -> Samples:
    """Samples of all edges, about a spacing apart."""
    found = meetings(faces, spacing)
    if len(found.points) == 0:
        return faces[np.zeros(len(faces), dtype=bool)]
    edges, kept = joined(found, fitted, spacing)
    tree = cKDTree(faces.points)
    owned = _owned(edges, faces, tree)
    edges, found = edges[owned], found[kept][owned]
    strip = strips_between(edges, faces, tree, fitted, spacing)
    cut = strip >= 0
    bridged = _bridged(edges[cut], strip[cut], found[cut], fitted, spacing)
    edges = thinned(edges[~cut] + bridged, _CELL * spacing)
    for _ in range(_ROUNDS):
        more = _in_gaps(edges, faces, tree, fitted, spacing)
        if len(more) == 0:
            break
        edges = edges + more
    return edges


def _in_gaps(
    edges: Samples, faces: Samples, tree: cKDTree, fitted: Sequence[FittedPatch], spacing: float
) -> Samples:
    """Samples half way between those of one edge that are far apart, unless something else lies there."""
    if len(edges) == 0:
        return edges
    _, group = np.unique(edges.labels, axis=0, return_inverse=True)
    apart = np.column_stack([edges.points, 10.0 * group.reshape(-1)])  # groups never mix
    along = cKDTree(apart)
    first, second = along.query_pairs(_GAP * spacing, output_type="ndarray").T
    size = np.linalg.norm(edges.points[first] - edges.points[second], axis=1)
    wide = size > _WIDE * spacing
    first, second, size = first[wide], second[wide], size[wide]
    middle = (edges.points[first] + edges.points[second]) / 2
    alone, _ = along.query(np.column_stack([middle, apart[first, 3]]))
    open_ = alone > 0.45 * size
    places = Meetings(middle[open_], edges.labels[first[open_]], size[open_], edges.convex[first[open_]])
    places = places[~_interrupted(places, edges)]
    added, kept = joined(replace(places, size=0.35 * places.size), fitted, spacing)
    reach = np.maximum(_OWN_REACH * spacing, places.size[kept])
    return thinned(added[_beside(added, edges, faces, tree, reach)], 0.5 * _CELL * spacing)


def _interrupted(places: Meetings, edges: Samples) -> Mask:
    """Whether both patches of each place (n,) in a gap of their edge meet a third one in that gap."""
    one, two = _third_patches(places.points, places.sides, edges, places.size / 2)
    return np.asarray(((one[:, :, None] == two[:, None]) & (one[:, :, None] >= 0)).any(axis=(1, 2)))


def _beside(added: Samples, edges: Samples, faces: Samples, tree: cKDTree, reach: Array) -> Mask:
    """Whether the face sample nearest to each edge sample (n,) is within reach (n,) and of one of its patches, or one
    that meets just one of them there: a strip with few points then lies between the edge and the patch."""
    distance, nearest = tree.query(added.points, workers=-1)
    other = faces.labels[nearest, 0]
    one, two = _third_patches(added.points, added.labels, edges, reach)
    over_a_strip = (one == other[:, None]).any(axis=1) != (two == other[:, None]).any(axis=1)
    own = (added.labels == other[:, None]).any(axis=1)
    return np.asarray((own | over_a_strip) & (distance < reach))


def _third_patches(points: Array, sides: Labels, edges: Samples, reach: Array) -> tuple[Labels, Labels]:
    """Patches (n, k), -1 for none, whose edge with the first and with the second of two `sides` (n, 2) comes within
    reach (n,) of each of the points (n, 3)."""
    distance, near = cKDTree(edges.points).query(points, k=list(range(1, min(_AROUND, len(edges)) + 1)))
    around = edges.labels[near]
    here = (distance < reach[:, None]) & (around != sides[:, None]).any(axis=2)
    one, two = (
        np.where(here & (around == side[:, None, None]).any(axis=2), around.sum(axis=2) - side[:, None], -1)
        for side in sides.T
    )
    return one, two


def meetings(faces: Samples, spacing: float) -> Meetings:
    """The middles between neighbouring face samples of two patches, one in each cell of half a spacing."""
    _, near = search_tree(faces.points).query(
        faces.points, k=_NEIGHBOURS + 1, distance_upper_bound=_REACH * spacing, workers=-1
    )
    first, rank = np.nonzero(near < len(faces))
    pairs = np.column_stack([first, near[first, rank]])
    sides = faces.labels[pairs, 0]
    use = (sides[:, 0] >= 0) & (sides[:, 0] < sides[:, 1])
    reverse = (sides[:, 1] >= 0) & (sides[:, 1] < sides[:, 0])
    pairs = np.vstack([pairs[use], pairs[reverse, ::-1]])
    sides = faces.labels[pairs, 0]
    ends, normals = faces.points[pairs], faces.normals[pairs, 0]
    across = ends[:, 1] - ends[:, 0]
    rise = np.einsum("ij,ij->i", across, normals[:, 0] - normals[:, 1])
    key = np.column_stack([np.floor(ends.mean(axis=1) / (0.5 * spacing)).astype(np.int64), sides])
    one = first_of_each(key)
    return Meetings(ends.mean(axis=1), sides, np.linalg.norm(across, axis=1), rise < 0)[one]


def joined(found: Meetings, fitted: Sequence[FittedPatch], spacing: float) -> tuple[Samples, Labels]:
    """The meetings moved onto both their surfaces, and which (k,) of them got there without going far."""
    points, good = found.points.copy(), np.zeros(len(found.points), dtype=bool)
    normals = np.zeros((len(points), 2, 3))
    for a, b in np.unique(found.sides, axis=0):
        at = np.flatnonzero((found.sides[:, 0] == a) & (found.sides[:, 1] == b))
        one, two = Side.of(fitted[a]), Side.of(fitted[b])
        points[at], missed = meeting(one, two, found.points[at], spacing)
        normals[at] = np.stack([one.outward(points[at]), two.outward(points[at])], axis=1)
        moved = np.linalg.norm(points[at] - found.points[at], axis=1)
        good[at] = (moved < np.maximum(found.size[at], 0.5 * spacing)) & (missed < 0.05 * spacing)
    kept = np.flatnonzero(good & np.isfinite(points).all(axis=1))
    return Samples(points[kept], found.sides[kept], normals[kept], found.convex[kept]), kept


def _owned(edges: Samples, faces: Samples, tree: cKDTree) -> Mask:
    """Whether the face sample nearest to each edge sample (n,) is of one of its patches."""
    _, nearest = tree.query(edges.points, workers=-1)
    return np.asarray((faces.labels[nearest, :1] == edges.labels).any(axis=1))


def strips_between(
    edges: Samples, faces: Samples, tree: cKDTree, fitted: Sequence[FittedPatch], spacing: float
) -> Labels:
    """The patch (n,) that cuts each edge sample off, or -1: its normal lies between those of the edge."""
    strip = np.full(len(edges), -1, dtype=np.int64)
    beside: dict[int, set[int]] = {}
    for a, b in np.unique(edges.labels, axis=0).tolist():
        beside.setdefault(a, set()).add(b)
        beside.setdefault(b, set()).add(a)
    for a, b in np.unique(edges.labels, axis=0).tolist():
        at = np.flatnonzero((edges.labels == (a, b)).all(axis=1))
        for c in beside[a] & beside[b]:
            side, own = Side.of(fitted[c]), faces.points[faces.labels[:, 0] == c]
            behind = at[_behind(edges[at], side, own, spacing)]
            if len(behind):
                contradicted = _contradicted(edges[behind], side, faces, tree, spacing)
                strip[behind[~contradicted]] = c
    return strip


def _behind(edges: Samples, strip: Side, own: Array, spacing: float) -> Mask:
    """Which samples of one edge (n,) lie behind a strip between its patches, with its points (m, 3) near."""
    if len(own) == 0:
        return np.zeros(len(edges), dtype=bool)
    depth = np.where(edges.convex, 1, -1) * strip.sign * strip.primitive.distance(edges.points)
    distance, _ = cKDTree(own).query(edges.points)
    near = (depth > _CUT_OFF * spacing) & (depth < _REACH * spacing) & (distance < _STRIP_REACH * spacing)
    return near & _is_between(strip.outward(strip.primitive.project(edges.points)), edges.normals)


def _contradicted(edges: Samples, strip: Side, faces: Samples, tree: cKDTree, spacing: float) -> Mask:
    """Whether points of its own patches lie behind the strip near an edge sample (n,): it is not cut off."""
    _, near = tree.query(edges.points, k=min(8, len(faces)))
    here = (faces.labels[near, :1] == edges.labels[:, None, :]).any(axis=2).ravel()
    points, two = faces.points[near.ravel()], np.repeat(edges.normals, near.shape[1], axis=0)
    direction = np.repeat(np.where(edges.convex, 1, -1), near.shape[1])
    behind = direction * strip.sign * strip.primitive.distance(points)
    within = _is_between(strip.outward(strip.primitive.project(points)), two)
    against = here & within & (behind > 1.5 * _CUT_OFF * spacing)
    return np.asarray(against.reshape(near.shape).any(axis=1))


def _is_between(normal: Array, two: Array) -> Mask:
    """Whether normals (n, 3) are about in the plane of the `two` (n, 2, 3) and on the shorter way between."""
    a, b = two[:, 0], two[:, 1]
    cosine = np.einsum("ij,ij->i", a, b)
    with_a, with_b = np.einsum("ij,ij->i", normal, a), np.einsum("ij,ij->i", normal, b)
    part_a, part_b = with_a - cosine * with_b, with_b - cosine * with_a
    across = np.cross(a, b)
    sine = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
    off = np.abs(np.einsum("ij,ij->i", normal, across)) / sine
    return np.asarray((sine > 0.2) & (part_a > 0.05 * sine) & (part_b > 0.05 * sine) & (off < 0.35))


def _bridged(
    edges: Samples, strip: Labels, found: Meetings, fitted: Sequence[FittedPatch], spacing: float
) -> Samples:
    """The two edges of the strips in front of the edges (n)."""
    if len(edges) == 0:
        return edges
    points, size = np.tile(edges.points, (2, 1)), np.tile(found.size, 2) + 2 * spacing
    sides = np.sort(np.column_stack([edges.labels.T.ravel(), np.tile(strip, 2)]), axis=1)
    samples, _ = joined(Meetings(points, sides, size, np.tile(edges.convex, 2)), fitted, spacing)
    return samples
