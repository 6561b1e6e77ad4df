"""What is nearly parallel, coaxial, equal or tangent becomes exactly so.

A relation is proposed where the fits' own covariances allow it, all are met at once by null-space
Gauss-Newton, and those that contradict others or pull a primitive off its points are dropped again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.constraints import Constraint, list_constraints
from sed2cad.fitting import angle_noise, used_points
from sed2cad.primitives.adopt import adopt_axes
from sed2cad.primitives.base import Array, FittedPatch
from sed2cad.primitives.patterns import Pattern, propose_patterns
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
from sed2cad.primitives.refine import median_size
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.rounding import propose_dimensions
from sed2cad.primitives.settle import settle
from sed2cad.primitives.solve_relations import Relation, members_of
from sed2cad.primitives.swept_align import align_swept
from sed2cad.primitives.symmetry import propose_symmetries
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Scan
from sed2cad.topology.model import Topology

_TANGENT_ANGLE = np.radians(14.0)  # between the normals of two faces along their common boundary
_ENOUGH = 30  # points of a patch that tell how its neighbours err
_FARTHEST = 5.0  # median residuals of a point that belongs


def regularize(
    scan: Scan, fitted: Sequence[FittedPatch], topology: Topology, step: float | None = None
) -> tuple[list[FittedPatch], list[Constraint]]:
    """The patches with primitives that obey the constraints to 1e-9, and the constraints.

    Directions come first, so that axes and planes are compared when they are parallel already; then everything
    together; then, with a step (unit frame), dimensions are rounded to its multiples; at last swept patches follow the
    others. B-splines stay as they are.
    """
    used = [used_points(patch.patch) for patch in fitted]
    noise = float(np.median([patch.rms for patch in fitted])) if fitted else 0.0
    angle, together = angle_noise(scan, fitted), likeness(scan, fitted, used)
    pieces = {
        index: piece(patch.primitive, scan.points[own], scan.normals[own], noise, angle, together)
        for index, (patch, own) in enumerate(zip(fitted, used))
        if patch.primitive.kind in ANALYTIC_KINDS and _is_known(patch, len(own), angle)
    }
    pieces, hosts = adopt_axes(pieces)
    aligned, directions = settle(pieces, propose_directions(pieces))
    relations = [
        *directions,
        *propose_coplanar(aligned, directions),
        *propose_coaxial(aligned, directions, hosts),
        *propose_radii(aligned),
        *propose_tangencies(aligned, tangent_pairs(fitted, topology), [patch.sign for patch in fitted]),
    ]
    settled, relations = settle(pieces, relations)
    patterns = _patterns(fitted, settled)
    if patterns:
        pieces |= {index: datum for pattern in patterns for index, datum in pattern.datums.items()}
        settled, relations, patterns = _repeated(pieces, settled, relations, patterns)
    dimensions = propose_dimensions(settled, relations, step) if step else []
    if dimensions:
        settled, relations = settle(pieces, [dimension.relation for dimension in dimensions], relations, settled)
    changed = members_of(relations)
    patches = [
        _refitted(patch, settled[k], scan.points[used[k]]) if k in changed else patch for k, patch in enumerate(fitted)
    ]
    patches, alignments = align_swept(patches, scan.points)
    constraints = list_constraints(pieces, settled, relations, patterns, dimensions)
    return patches, constraints + [Constraint(a.kind, (a.leader, a.index), a.residual) for a in alignments]


def _patterns(fitted: Sequence[FittedPatch], settled: Pieces) -> list[Pattern]:
    """All that seems to repeat; the datums are numbered after the patches."""
    sides = {index: fitted[index].sign for index in settled}
    patterns = propose_patterns(settled, sides, len(fitted))
    first = len(fitted) + sum(len(pattern.datums) for pattern in patterns)
    return patterns + propose_symmetries(settled, sides, first)


def _repeated(
    pieces: Pieces, settled: Pieces, relations: list[Relation], patterns: list[Pattern]
) -> tuple[Pieces, list[Relation], list[Pattern]]:
    """The pieces under the relations, as they are settled, and as many patterns as go with them, and these.

    What is left of a pattern has to be one.
    """
    proposed = [relation for pattern in patterns for relation in pattern.relations]
    found, kept = settle(pieces, proposed, relations, settled)
    whole = [pattern for pattern in patterns if pattern.is_whole(kept)]
    lost = {relation for pattern in patterns if pattern not in whole for relation in pattern.relations}
    if lost & set(kept):
        found, kept = settle(pieces, [], [relation for relation in kept if relation not in lost], settled)
    return found, kept, whole


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


def likeness(scan: Scan, fitted: Sequence[FittedPatch], used: Sequence[NDArray[np.int64]]) -> float:
    """Correlation of the residuals of neighbours on one patch, over all that are known well: 0 to 1."""
    products, squares = 0.0, 0.0
    for patch, own in zip(fitted, used):
        if len(own) < _ENOUGH or patch.primitive.kind not in ANALYTIC_KINDS:
            continue
        residual = patch.primitive.distance(scan.points[own])
        limit = _FARTHEST * median_size(residual)
        feet = patch.primitive.project(scan.points[own])  # the nearest points themselves are those that err alike
        other = residual[cKDTree(feet).query(feet, 2)[1][:, 1]]
        fair = (np.abs(residual) <= limit) & (np.abs(other) <= limit)
        products += float(residual[fair] @ other[fair])
        squares += float(residual[fair] @ residual[fair] + other[fair] @ other[fair]) / 2
    return min(max(products / squares, 0.0), 1.0) if squares > 0 else 1.0


def _refitted(patch: FittedPatch, settled: Piece, points: Array) -> FittedPatch:
    rms = root_mean_square(settled.primitive.distance(points))
    return replace(patch, primitive=settled.primitive, rms=rms, covariance=settled.covariance)


def _is_known(patch: FittedPatch, points: int, angle: float) -> bool:
    """Whether so many points tell the primitive: their normals count where these are known to be good for something."""
    if not math.isfinite(angle):
        return points > patch.primitive.freedom
    return 3 * points >= patch.primitive.freedom and patch.patch.kind == patch.primitive.kind
