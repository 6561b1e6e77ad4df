"""Which pairs of faces that are exactly parallel, perpendicular, coaxial or of one radius come out so, and which do
that are not: noisy scans of true parts, with true labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sed2cad.errors import AssemblyError, ScanError
from sed2cad.evaluation.pool import of_each
from sed2cad.evaluation.tables import aligned
from sed2cad.evaluation.trial import Trial, cloud_of, make_trial
from sed2cad.fitting import fit_patches
from sed2cad.network.types import BSPLINE, CYLINDER, PATCH_TYPES, PLANE, SPHERE, TORUS
from sed2cad.primitives.base import Array, FittedPatch, Patch
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.relations import placement
from sed2cad.regularize import regularize
from sed2cad.topology.model import Topology
from sed2cad.topology.trace import trace
from sed2cad.training.dataset import load_part
from sed2cad.training.labelled_part import LabelledCloud, LabelledPart
from sed2cad.training.samples import EDGE_DISTANCE

NOISE = 0.01
"""Displacement along the normal in radii of the part: a third of a percent of its diagonal, uniform."""
RELATIONS = ("parallel", "perpendicular", "coaxial", "equal radius")
LEAST = (1, 30)
"""Pairs of all patches, and of those only that have so many points each."""
MADE = 1e-7
"""Radians and unit lengths: solved relations hold to 1e-9."""
TRUE = 1e-5
"""Of the truth, which for surfaces found in B-spline form is only known so well."""

Matrix = NDArray[np.bool_]


@dataclass(frozen=True)
class RelationCounts:
    """Pairs of patches of one part or of many."""

    relation: str
    points: int  # of both patches, at least
    true: int  # pairs that are so
    found: int  # of these, pairs that come out exactly so
    false: int  # pairs that come out exactly so, but are not
    others: int  # pairs that are not so


@dataclass(frozen=True)
class Axes:
    """What k surfaces are to each other is told by these; nan where a surface has no such thing."""

    direction: Array  # (k, 3) normal of a plane, axis of the others
    position: Array  # (k, 3) a point of the axis; none for planes
    radius: Array  # (k,) of cylinders and spheres, of the tube of a torus

    def pairs(self, tolerance: float) -> dict[str, tuple[Matrix, Matrix]]:
        """For each of RELATIONS, which pairs (i < j) of surfaces could be so, and which are."""
        known = np.isfinite(self.direction[:, 0])
        oriented, placed, round_ = known, known & np.isfinite(self.position[:, 0]), np.isfinite(self.radius)
        sine = np.linalg.norm(np.cross(self.direction[:, None], self.direction[None]), axis=-1)
        cosine = np.abs(self.direction @ self.direction.T)
        gap = self.position[None] - self.position[:, None]
        off = np.linalg.norm(np.cross(gap, self.direction[:, None]), axis=-1)
        radii = np.abs(self.radius[:, None] - self.radius[None])
        holds = (
            (oriented, sine < tolerance),
            (oriented, cosine < tolerance),
            (placed, (sine < tolerance) & (off < tolerance)),
            (round_, radii < tolerance),
        )
        return {
            name: (upper := np.triu(np.outer(able, able), 1), upper & so)
            for name, (able, so) in zip(RELATIONS, holds)
        }


def evaluate_relations(files: Sequence[Path], workers: int = 1) -> list[RelationCounts]:
    """All pairs of all parts, packed or CAD files; a part that makes no scan has none."""
    return total(of_each(_counts, files, workers))


def _counts(path: Path) -> list[RelationCounts]:
    try:
        return score_relations(path)
    except ScanError:
        return [RelationCounts(relation, points, 0, 0, 0, 0) for points in LEAST for relation in RELATIONS]


def score_relations(path: Path, noise: float = NOISE, seed: int = 0) -> list[RelationCounts]:
    """One packed part, scanned with noise, its true patches fitted and regularised. ScanError."""
    part, cloud = load_part(path), cloud_of(path, None, seed)
    trial = make_trial(cloud, noise, seed, path.stem)
    numbers, patches = true_patches(cloud, trial)
    fitted = fit_patches(trial.scan, patches)
    try:
        traced = trace(trial.scan, fitted)
        fitted, topology = list(traced.fitted), traced.topology
    except AssemblyError:  # no proxy: there are no neighbours that could be tangent
        topology = Topology((), (), np.zeros((0, 3)), 0.0)
    settled = regularize(trial.scan, fitted, topology)[0][: len(patches)]
    truth, made = true_axes(part, numbers).pairs(TRUE), fitted_axes(settled).pairs(MADE)
    size = np.array([len(patch.indices) for patch in patches])
    large = {points: np.outer(size >= points, size >= points) for points in LEAST}
    rows = ((name, points, *truth[name], made[name][1]) for points in LEAST for name in RELATIONS)
    return [count(name, n, able & large[n], true & large[n], so & large[n]) for name, n, able, true, so in rows]


def count(relation: str, points: int, able: Matrix, true: Matrix, made: Matrix) -> RelationCounts:
    """Of the pairs that are able."""
    others = able & ~true
    numbers = (int(pairs.sum()) for pairs in (true, true & made, others & made, others))
    return RelationCounts(relation, points, *numbers)


def total(rows: Sequence[Sequence[RelationCounts]]) -> list[RelationCounts]:
    """Of many parts."""
    return [
        replace(same[0], **{name: sum(getattr(row, name) for row in same) for name in _NUMBERS})
        for same in zip(*rows)
    ]


_NUMBERS = ("true", "found", "false", "others")


def relations_text(rows: Sequence[RelationCounts]) -> str:
    """Shares of the pairs."""
    table = [["relation", "points", "true pairs", "found", "share", "other pairs", "made so", "share"]]
    for row in rows:
        found, false = row.found / max(row.true, 1), row.false / max(row.others, 1)
        true = [str(row.true), str(row.found), f"{100 * found:.1f} %"]
        table.append([row.relation, f"{row.points}+", *true, str(row.others), str(row.false), f"{100 * false:.2f} %"])
    return "\n".join(aligned(table))


def true_patches(cloud: LabelledCloud, trial: Trial) -> tuple[NDArray[np.int64], list[Patch]]:
    """The number of each true patch that the scan has points of, and the patches."""
    kept = trial.row >= 0
    row, patch = trial.row[kept], cloud.patch[kept]
    interior = cloud.edge_distance[kept] > EDGE_DISTANCE
    numbers = np.unique(patch).astype(np.int64)
    members = [np.flatnonzero(patch == number) for number in numbers]
    kinds = [PATCH_TYPES[cloud.type[kept][own[0]]] for own in members]
    return numbers, [Patch(row[own], kind, interior[own]) for own, kind in zip(members, kinds)]


def true_axes(part: LabelledPart, numbers: NDArray[np.int64]) -> Axes:
    """Of the surfaces of patches (k,)."""
    face = np.array([int(np.flatnonzero(part.patch == number)[0]) for number in numbers], dtype=np.int64)
    kind = part.type[face]
    direction, position = part.axis[face].copy(), part.origin[face].copy()
    direction[np.isin(kind, (BSPLINE, SPHERE))] = np.nan
    position[np.isin(kind, (BSPLINE, PLANE))] = np.nan
    radius = np.where(kind == TORUS, part.radii[face, 1], part.radii[face, 0])
    radius = np.where(np.isin(kind, (CYLINDER, SPHERE, TORUS)), radius, np.nan)
    return Axes(direction, position, radius)


def fitted_axes(fitted: Sequence[FittedPatch]) -> Axes:
    """Of fitted patches."""
    rows = np.full((len(fitted), 7), np.nan)
    for row, patch in zip(rows, fitted):
        kind = patch.primitive.kind
        if kind not in ANALYTIC_KINDS:
            continue
        place = placement(patch.primitive)
        if kind != "sphere":
            row[:3] = place[:3]
        if kind != "plane":
            row[3:6] = place[3:6]
        if kind in ("cylinder", "sphere", "torus"):
            row[6] = place[7 if kind == "torus" else 6]
    return Axes(rows[:, :3], rows[:, 3:6], rows[:, 6])
