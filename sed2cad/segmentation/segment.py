"""The stage: a scan and what the network says about it become patches with primitives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.network.predict import PointLabels
from sed2cad.network.types import BSPLINE
from sed2cad.primitives.base import Patch
from sed2cad.primitives.robust_fit import FINEST
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.corners import Corners, on_surfaces
from sed2cad.segmentation.energy import UNEXPLAINED, Tolerances
from sed2cad.segmentation.flats import with_flats
from sed2cad.segmentation.graph import FACING, Graph
from sed2cad.segmentation.level import FLOOR, Level
from sed2cad.segmentation.linkage import average_linkage, pair_evidence
from sed2cad.segmentation.mean_shift import mean_shift
from sed2cad.segmentation.misfits import LEAST, with_misfits
from sed2cad.segmentation.refine import FEW, FEWEST, State
from sed2cad.segmentation.settle import settle
from sed2cad.segmentation.strips import groups

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

COARSE = 10_000  # points that the first refinement sees: those that the network sees
FINE = 100_000  # points that the second one sees; of a scan with more, the others follow their neighbours
FINE_ROUNDS = 2
RIM = 4.0  # spacings, two points' distance: estimated normals bend that far from an edge
SHARP_ROUNDS = 3
SHARPEST = 0.045  # radians: no normals are trusted more, as a tessellation leaves that much
NEARLY_ALL = 0.98
OF_A_MESH = 0.99  # its bad normals come in groups, where the triangles are large
UNEVEN = 5e-3  # unit frame: deviation of an uneven surface from the simple one that is meant
MANY = 100  # patches
ALL_SMOOTH = 0.9  # share of the borders that are smooth: no face that parts cut up has an edge in it
PARALLEL = 0.985  # cosine
FEWER = 0.5  # so many of the patches are left where an uneven surface is taken for the simple one that is meant
COMMON = 0.8  # share of planes and cylinders: 0.87 of the faces of real parts, 0.7 of the pieces of an uneven one
EDGE = 0.75  # probability from which a point counts as an edge point


@dataclass(frozen=True)
class Segmentation:
    """Patches, and the scan as they see it."""

    patches: list[Patch]
    scan: Scan  # with their deviation for its noise; a mesh with its points on the surfaces of its vertices
    plainer: list[Patch] | None = None  # without what a few points show, for want of a solid with it


def segment(scan: Scan, labels: PointLabels | None, seed: int = 0, most: float = UNEVEN) -> Segmentation:
    """Patches of the scan: what the network and smooth pieces propose, refined by the primitives they lead to.

    First on the points that the network sees, with a wide tolerance of their normals and, where these turn out to be
    better, with a narrow one. Then, where there are more, on all points: the small faces that were a handful of them
    are found there. A surface more uneven than the noise of a real scan, as cast and bent things have, falls to pieces
    of all kinds, or to some without an edge between them; then `most` is taken for its noise.

    The vertices of a CAD system's mesh lie on its surfaces exactly: they tell patches apart that hardly differ.
    """
    freeform = labels.types[:, BSPLINE].astype(float) if labels is not None else None
    noise, level, state = _first_look(scan, labels, freeform, seed, most)
    tolerances = Tolerances(distance=max(FLOOR, noise))
    angle = _turned(level, state, tolerances, scan)
    if angle < tolerances.angle:
        tolerances = replace(tolerances, angle=angle)
        state = level.refiner(tolerances, freeform).improve(state, SHARP_ROUNDS)
    if len(scan.points) > len(level.rows):
        level, state = _closer_look(scan, level, state, tolerances, freeform, seed)
    kinds = settle(level, state, tolerances, noise)
    edge = labels.edge[labels.nearest] > EDGE if labels is not None else np.zeros(len(scan.points), bool)
    settled = replace(scan, noise=noise)
    if level.corners is not None:
        everyone = spread(level, state.labels, scan.points, scan.normals)
        held = ((np.flatnonzero(everyone == k), c.primitive, c.sign) for k, c in enumerate(state.primitives))
        corners = Corners.of(settled)
        assert corners is not None
        return Segmentation(_patches(scan, level, state.labels, kinds, edge), on_surfaces(settled, corners, held))
    if noise > FINEST:
        return Segmentation(_patches(scan, level, state.labels, kinds, edge), settled)
    more = with_misfits(level, state, tolerances)
    kinds_of_more = kinds + [choice.primitive.kind for choice in more.primitives[len(kinds) :]]
    plainer, patches = (
        _patches(scan, level, *with_flats(level.points, level.normals, found.labels, names, level.fewest), edge)
        for found, names in ((state, kinds), (more, kinds_of_more))
    )
    return Segmentation(patches, settled, plainer if more is not state else None)


def _patches(scan: Scan, level: Level, labels: Labels, kinds: Sequence[str], edge: NDArray[np.bool_]) -> list[Patch]:
    """Patches of all points of the scan from the labels (m,) of the level's; edge (n,): points that are not inner."""
    everyone = spread(level, labels, scan.points, scan.normals)
    interior = _inside(scan, everyone) & ~edge
    members = [np.flatnonzero(everyone == k) for k in range(len(kinds))]
    return [Patch(own, kind, interior[own]) for own, kind in zip(members, kinds) if len(own) >= LEAST]


def _first_look(
    scan: Scan, labels: PointLabels | None, freeform: Array | None, seed: int, most: float
) -> tuple[float, Level, State]:
    """Patches among the points that the network sees, and the deviation that is taken for noise."""
    rows = labels.seen if labels is not None else _some(scan, COARSE, seed)

    def look(noise: float) -> tuple[float, Level, State]:
        tolerances = Tolerances(distance=max(FLOOR, noise))
        level = Level.of(scan, rows, tolerances)
        return noise, level, level.refiner(tolerances, freeform).run(_proposals(level, labels, seed))

    noise, level, state = look(scan.noise)
    if not FINEST < noise < most:
        return noise, level, state
    pieces = falls_to_pieces([choice.primitive.kind for choice in state.primitives])
    if not pieces and smooth_borders(level, state) < ALL_SMOOTH:
        return noise, level, state
    simpler = look(most)
    fewer = len(simpler[2].primitives) <= FEWER * len(state.primitives)
    return simpler if pieces or fewer else (noise, level, state)


def _closer_look(
    scan: Scan, level: Level, state: State, tolerances: Tolerances, freeform: Array | None, seed: int
) -> tuple[Level, State]:
    """The patches of some points, refined on all; of a noisy scan, what few of them made up is found again."""
    fine, labels = Level.of(scan, _some(scan, FINE, seed), tolerances), state.labels
    if scan.noise > FINEST:  # estimated normals err together: by chance like a face, and along edges as on a fillet
        fine = replace(fine, fewest=max(FEWEST, FEWEST * len(fine.rows) // (2 * COARSE)), rim=RIM)
        labels = np.where(np.bincount(labels + 1)[labels + 1] < FEW, UNEXPLAINED, labels)
    nearest = spread(level, np.arange(len(level.rows)), fine.points, fine.normals)
    refiner = fine.refiner(tolerances, None if freeform is None else freeform[nearest])
    state = State(labels[nearest], state.primitives).compact()
    if fine.part is not None:
        state = refiner.start([state.labels, _large(fine.part)])
    return fine, refiner.improve(state, FINE_ROUNDS)


def falls_to_pieces(kinds: Sequence[str]) -> bool:
    """Whether there are many patches and too few of them planes and cylinders for a machined part."""
    common = sum(kind in ("plane", "cylinder") for kind in kinds)
    return len(kinds) >= MANY and common < COMMON * len(kinds)


def smooth_borders(level: Level, state: State) -> float:
    """Share of the neighbours on two patches whose surfaces are nearly parallel there; 0 where there are none."""
    pairs = level.graph.pairs[(state.labels[level.graph.pairs] >= 0).all(axis=1)]
    i, j = pairs[np.diff(state.labels[pairs])[:, 0] != 0].T
    if len(i) == 0:
        return 0.0
    normals = np.zeros_like(level.points)
    for members, choice in zip(groups(state.labels), state.primitives):
        normals[members] = choice.sign * choice.primitive.normal(level.points[members])
    return float((np.einsum("ij,ij->i", normals[i], normals[j]) > PARALLEL).mean())


def _proposals(level: Level, labels: PointLabels | None, seed: int) -> list[Labels]:
    """Smooth pieces of two sizes, the modes of the descriptors, and what the pairs of neighbours link; the parts and
    planes of a mesh."""
    graph = level.graph
    proposals = [smooth_pieces(graph, weight) for weight in (0.85, 0.5)]
    if level.part is not None and level.corners is not None:
        proposals += [_large(level.part), _large(level.corners.facets)]
    i, j = graph.pairs.T
    if labels is not None:
        linked = average_linkage(pair_evidence(labels), labels.neighbours)
        for clusters in (mean_shift(labels.descriptors, seed=seed), linked):
            proposals.append(_large(graph.components(clusters[i] == clusters[j])))
    return proposals


def smooth_pieces(graph: Graph, weight: float) -> Labels:
    """Region growing: connected pieces over pairs whose normals agree (weight above the given one)."""
    return _large(graph.components(graph.weights > weight))


def spread(level: Level, labels: Labels, points: Array, normals: Array) -> Labels:
    """Labels (n,) for points (n, 3): of the level's nearest one, on their side of a wall."""
    if len(level.points) == len(points):
        return labels
    turn = 2 * level.graph.spacing
    tree = cKDTree(np.hstack([level.points, turn * level.normals]))
    return np.asarray(labels[tree.query(np.hstack([points, turn * normals]), workers=-1)[1]])


def _some(scan: Scan, most: int, seed: int) -> NDArray[np.int64]:
    """At most so many of the points, ascending, the same for the same seed."""
    return np.sort(np.random.default_rng(seed).permutation(len(scan.points))[:most])


def _turned(level: Level, state: State, tolerances: Tolerances, scan: Scan) -> float:
    """How far nearly all normals of round faces turn out to be off, radians; of all faces, where none is round.

    Only patches whose kind is the settled one tell: others are several faces in one. Infinite where nothing tells, or
    where the points themselves are noisy.
    """
    if scan.noise > FINEST:
        return math.inf
    kinds = settle(level, state, tolerances, scan.noise)
    found = [
        (kind != "plane", choice.primitive.angles(level.points[members], level.normals[members]))
        for members, choice, kind in zip(groups(state.labels), state.primitives, kinds)
        if kind == choice.primitive.kind and choice.primitive.freedom
    ]
    angles = [angle for is_round, angle in found if is_round] or [angle for _, angle in found]
    share = NEARLY_ALL if scan.part is None else OF_A_MESH
    return max(SHARPEST, float(np.quantile(np.concatenate(angles), share))) if angles else math.inf


def _large(labels: Labels) -> Labels:
    size = np.bincount(labels + 1)[labels + 1]
    return np.where(size >= FEWEST, labels, UNEXPLAINED)


def _inside(scan: Scan, labels: Labels, k: int = 6) -> NDArray[np.bool_]:
    """Points whose nearest neighbours all lie on the same patch, but for those on the other side of a wall: noise takes
    some points of a thin one nearer to them, and the others alone would be a biased sample."""
    near = scan.around[:, :k]
    facing = np.einsum("ij,ikj->ik", scan.normals, scan.normals[near]) < FACING
    return np.asarray(((labels[near] == labels[:, None]) | facing).all(axis=1))
