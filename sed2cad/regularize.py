"""What is nearly parallel, coaxial, equal or tangent becomes exactly so.

A relation is proposed where the fits' own covariances allow it, all are met at once by null-space
Gauss-Newton, and those that contradict others or pull a primitive off its points are dropped again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.fitting import angle_noise, root_mean_square, used_points
from sed2cad.primitives.adopt import adopt_axes
from sed2cad.primitives.base import Array, FittedPatch, Primitive
from sed2cad.primitives.proposals import (
    Piece,
    Pieces,
    piece,
    propose_coaxial,
    propose_coplanar,
    propose_directions,
    propose_radii,
    propose_tangencies,
)
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.solve_relations import Relation, satisfy, tensions, violations
from sed2cad.scan.scan import Scan
from sed2cad.topology.model import Topology

_TANGENT_ANGLE = np.radians(14.0)  # between the normals of two faces along their common boundary
_BROKEN = 1e-9  # residual of a relation that was not met
_ASTRAY = 1e-4  # residual that shows a contradiction, not a relation that others imply
_SECOND_CHANCES = 12  # attempts to take dropped relations in again


@dataclass(frozen=True)
class Constraint:
    """A relation between two patches that now holds exactly."""

    kind: str  # parallel, perpendicular, coaxial, concentric, coplanar, equal_radius, tangent, same
    a: int  # index into the fitted patches
    b: int
    residual: float  # before: the largest of its residuals, radians or unit frame


def regularize(
    scan: Scan, fitted: Sequence[FittedPatch], topology: Topology
) -> tuple[list[FittedPatch], list[Constraint]]:
    """The patches with primitives that obey the constraints to 1e-9, and the constraints.

    Directions come first, so that axes and planes are compared
    when they are parallel already; then everything together. B-splines stay as they are.
    """
    used = [used_points(patch.patch) for patch in fitted]
    noise = float(np.median([patch.rms for patch in fitted])) if fitted else 0.0
    angle = angle_noise(scan, fitted)
    pieces = {
        index: piece(patch.primitive, scan.points[own], scan.normals[own], noise, angle)
        for index, (patch, own) in enumerate(zip(fitted, used))
        if patch.primitive.kind in ANALYTIC_KINDS and _is_known(patch, len(own), angle)
    }
    pieces = adopt_axes(pieces)
    aligned, directions = _settled(pieces, propose_directions(pieces))
    relations = [
        *directions,
        *propose_coplanar(aligned, directions),
        *propose_coaxial(aligned, directions),
        *propose_radii(aligned),
        *propose_tangencies(aligned, tangent_pairs(fitted, topology)),
    ]
    settled, relations = _settled(pieces, relations)
    before = violations(_primitives(pieces), relations)
    constraints = [Constraint(r.kind, r.a, r.b, float(size)) for r, size in zip(relations, before)]
    changed = {index for relation in relations for index in (relation.a, relation.b)}
    patches = [
        _refitted(patch, settled[k], scan.points[used[k]]) if k in changed else patch
        for k, patch in enumerate(fitted)
    ]
    return patches, constraints


def tangent_pairs(fitted: Sequence[FittedPatch], topology: Topology) -> list[tuple[int, int]]:
    """Patches (a < b) whose outward normals nearly agree along a common chain."""
    pairs: set[tuple[int, int]] = set()
    for chain in topology.chains:
        sides = sorted({topology.regions[side].primitive for side in (chain.left, chain.right)})
        if len(sides) < 2:
            continue
        first, second = (fitted[side].primitive.normal(chain.points) * fitted[side].sign for side in sides)
        if np.median(np.einsum("ij,ij->i", first, second)) > np.cos(_TANGENT_ANGLE):
            pairs.add((sides[0], sides[1]))
    return sorted(pairs)


def _primitives(pieces: Pieces) -> dict[int, Primitive]:
    return {index: entry.primitive for index, entry in pieces.items()}


def _refitted(patch: FittedPatch, settled: Piece, points: Array) -> FittedPatch:
    rms = root_mean_square(settled.primitive.distance(points))
    return replace(patch, primitive=settled.primitive, rms=rms, covariance=settled.covariance)


def _is_known(patch: FittedPatch, points: int, angle: float) -> bool:
    """Whether so many points tell the primitive: their normals count where these are known to be good for something."""
    if not math.isfinite(angle):
        return points > patch.primitive.freedom
    return 3 * points >= patch.primitive.freedom and patch.patch.kind == patch.primitive.kind


def _settled(pieces: Pieces, relations: list[Relation]) -> tuple[Pieces, list[Relation]]:
    """The pieces under as many of the relations as go together, and these.

    First the culprits of every conflict are dropped until all is sound, then what was dropped gets a second
    chance, by halves.
    """
    start, evidence = _primitives(pieces), {index: entry.evidence for index, entry in pieces.items()}
    kept = list(relations)
    solved = satisfy(start, kept, evidence)
    while not _is_sound(pieces, solved, kept):
        culprits = _culprits(pieces, solved, kept)
        kept = [relation for k, relation in enumerate(kept) if k not in culprits]
        solved = satisfy(start, kept, evidence)
    waiting = [[relation for relation in relations if relation not in kept]]
    for _ in range(_SECOND_CHANCES):
        batch = waiting.pop() if waiting else []
        if not batch:
            break
        trial = satisfy(start, kept + batch, evidence)
        if _is_sound(pieces, trial, kept + batch):
            kept, solved = kept + batch, trial
        elif len(batch) > 1:
            waiting += [batch[len(batch) // 2 :], batch[: len(batch) // 2]]
    return {index: replace(entry, primitive=solved[index]) for index, entry in pieces.items()}, kept


def _is_sound(pieces: Pieces, solved: Mapping[int, Primitive], relations: Sequence[Relation]) -> bool:
    """Whether all relations hold and all primitives are still on their points."""
    met = violations(solved, relations).max(initial=0.0) <= _BROKEN
    return bool(met) and not any(entry.spoiled_by(solved[index]) for index, entry in pieces.items())


def _culprits(pieces: Pieces, solved: Mapping[int, Primitive], relations: Sequence[Relation]) -> set[int]:
    """Relations to give up: those that were not met, or the most harmful one at each spoiled primitive."""
    left = violations(solved, relations)
    broken = left > _BROKEN
    if (
        broken.sum() > 3 and left.max() > _ASTRAY
    ):  # no solution at all: this says little about any one of them
        places = {index for r, bad in zip(relations, broken) if bad for index in (r.a, r.b)}
        strain = np.array(
            [relation.strain if {relation.a, relation.b} & places else 0 for relation in relations]
        )
        return set(np.argsort(-strain)[: 1 + len(relations) // 20].tolist())
    if broken.any():
        return set(np.flatnonzero(broken).tolist())
    places = {index for index, entry in pieces.items() if entry.spoiled_by(solved[index])}
    evidence = {index: entry.evidence for index, entry in pieces.items()}
    harm = tensions(_primitives(pieces), solved, relations, evidence)
    return _worst_at(places, relations, harm)


def _worst_at(places: set[int], relations: Sequence[Relation], harm: Array) -> set[int]:
    """The most harmful relation at each of these primitives, at most one to a primitive."""
    dropped: set[int] = set()
    done: set[int] = set()
    for k in np.argsort(-harm).tolist():
        ends = {relations[k].a, relations[k].b}
        if ends & places and not ends & done:
            dropped.add(k)
            done |= ends
    return dropped
