"""What regularisation has made exact, relation by relation, for the report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sed2cad.primitives.patterns import Datum, Pattern
from sed2cad.primitives.proposals import Pieces
from sed2cad.primitives.relations import placement
from sed2cad.primitives.rounding import Dimension
from sed2cad.primitives.settle import primitives_of
from sed2cad.primitives.solve_relations import Relation, violations

_TOLD = ("centred", "aligned")  # of what holds the datum of a pattern


@dataclass(frozen=True)
class Constraint:
    """What now holds exactly between patches, or of one. Lengths in the unit frame, angles in radians."""

    kind: str  # parallel, perpendicular, coaxial, concentric, coplanar, equal_radius, tangent, same, rounded,
    # bolt_circle, linear_pattern, grid_pattern, centred (on an axis), aligned (with a plane), symmetric
    patches: tuple[int, ...]  # indices into the fitted patches
    residual: float  # before: the largest of its residuals
    measure: str = ""  # of a dimension: radius, distance, half_angle, ...
    before: float = np.nan  # of a dimension: its value without this constraint
    after: float = np.nan
    detail: str = ""  # of a pattern: "every 60 degrees"


def list_constraints(
    pieces: Pieces,
    settled: Pieces,
    relations: Sequence[Relation],
    patterns: Sequence[Pattern],
    dimensions: Sequence[Dimension],
) -> list[Constraint]:
    """The relations that hold now, with their residuals on the raw fits: pairs, patterns, what was rounded.

    `pieces` are the raw fits, `settled` what became of them; both with the datums of the patterns.
    """
    off = dict(zip(relations, violations(primitives_of(pieces), relations).tolist()))
    special = {relation for pattern in patterns for relation in pattern.relations}
    special |= {dimension.relation for dimension in dimensions}
    constraints = [Constraint(r.kind, r.members, off[r]) for r in relations if r not in special]
    for pattern in patterns:
        constraints += _of_pattern(pattern, pieces, settled, off)
    for dimension in dimensions:
        if dimension.relation in off:
            before, after = abs(dimension.before), abs(dimension.after)
            patches = _patches(dimension.members, pieces)
            constraints.append(Constraint("rounded", patches, abs(after - before), dimension.measure, before, after))
    return constraints


def _of_pattern(
    pattern: Pattern, pieces: Pieces, settled: Pieces, off: dict[Relation, float]
) -> Iterator[Constraint]:
    """The pattern itself, once for each of its pitches, and what it is centred on or aligned with."""
    images = [relation for relation in pattern.images if relation in off]
    worst = max(off[relation] for relation in images)
    patches = tuple(sorted({k for relation in images for k in relation.members} - set(pattern.datums)))
    for index, datum in pattern.datums.items():
        if datum.measure:
            before, after = (float(placement(held[index].primitive)[6]) for held in (pieces, settled))
            yield Constraint(pattern.kind, patches, worst, datum.measure, before, after, pattern.detail)
        else:
            yield Constraint(pattern.kind, patches, worst)
    for relation in pattern.others:
        if relation in off and relation.kind in _TOLD:
            yield Constraint(relation.kind, (relation.members[0], *patches), off[relation])


def _patches(members: Iterable[int], pieces: Pieces) -> tuple[int, ...]:
    """A datum stands for its whole pattern."""
    found: list[int] = []
    for index in members:
        entry = pieces[index]
        found += [k for k in (entry.patches if isinstance(entry, Datum) else (index,)) if k not in found]
    return tuple(found)
