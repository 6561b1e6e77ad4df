"""As many relations as go together, and the primitives under them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.proposals import Pieces
from sed2cad.primitives.solve_relations import Relation, satisfy, tensions, violations

_BROKEN = 1e-9  # residual of a relation that was not met
_ASTRAY = 1e-4  # residual that shows a contradiction, not a relation that others imply
_SECOND_CHANCES = (12, 4)  # attempts to take dropped relations in again: alone, or where others are given


def settle(
    pieces: Pieces, proposed: Sequence[Relation], given: Sequence[Relation] = (), settled: Pieces | None = None
) -> tuple[Pieces, list[Relation]]:
    """The pieces under the given relations, which go together, and as many of the proposed ones as go with them.

    `settled` are those of the pieces that obey the given relations already, to start from.

    First the culprits of every conflict are dropped until all is sound, then what was dropped gets a second
    chance, by halves. All relations that hold come back, the given ones first.
    """
    start = primitives_of({**pieces, **(settled or {})})
    evidence = {index: entry.evidence for index, entry in pieces.items()}
    kept = [*given, *proposed]
    solved = satisfy(start, kept, evidence)
    while len(kept) > len(given) and not _is_sound(pieces, solved, kept):
        culprits = _culprits(pieces, solved, kept, len(given))
        kept = [relation for k, relation in enumerate(kept) if k not in culprits]
        solved = satisfy(start, kept, evidence)
    waiting = [[relation for relation in proposed if relation not in kept]]
    for _ in range(_SECOND_CHANCES[bool(given)]):
        batch = waiting.pop() if waiting else []
        if not batch:
            break
        trial = satisfy(start, kept + batch, evidence)
        if _is_sound(pieces, trial, kept + batch):
            kept, solved = kept + batch, trial
        elif len(batch) > 1:
            waiting += [batch[len(batch) // 2 :], batch[: len(batch) // 2]]
    return {index: replace(entry, primitive=solved[index]) for index, entry in pieces.items()}, kept


def primitives_of(pieces: Pieces) -> dict[int, Primitive]:
    """Without what the points say about them."""
    return {index: entry.primitive for index, entry in pieces.items()}


def _is_sound(pieces: Pieces, solved: Mapping[int, Primitive], relations: Sequence[Relation]) -> bool:
    """Whether all relations hold and all primitives are still on their points."""
    met = violations(solved, relations).max(initial=0.0) <= _BROKEN
    return bool(met) and not any(entry.spoiled_by(solved[index]) for index, entry in pieces.items())


def _culprits(
    pieces: Pieces, solved: Mapping[int, Primitive], relations: Sequence[Relation], given: int
) -> set[int]:
    """Relations to give up: those that were not met, or the most harmful one at each spoiled primitive.

    Never the first ones, which are given: where only they seem to blame, the most strained of the others.
    """
    left = violations(solved, relations)
    broken = left > _BROKEN
    if broken.sum() > 3 and left.max() > _ASTRAY:  # no solution at all: this says little about any one of them
        places = {index for r, bad in zip(relations, broken) if bad for index in r.members}
        culprits = _most_strained(relations, places, given)
    elif broken.any():
        culprits = set(np.flatnonzero(broken).tolist())
    else:
        places = {index for index, entry in pieces.items() if entry.spoiled_by(solved[index])}
        evidence = {index: entry.evidence for index, entry in pieces.items()}
        culprits = _worst_at(places, relations, tensions(primitives_of(pieces), solved, relations, evidence), given)
    culprits = {k for k in culprits if k >= given}
    return culprits or _most_strained(relations, set(pieces), given)


def _most_strained(relations: Sequence[Relation], places: set[int], given: int) -> set[int]:
    """A twentieth of the relations that touch these primitives, but not of the given ones."""
    strain = [relation.strain if places & set(relation.members) else 0.0 for relation in relations[given:]]
    return set((given + np.argsort(-np.array(strain))[: 1 + len(strain) // 20]).tolist())


def _worst_at(places: set[int], relations: Sequence[Relation], harm: Array, given: int) -> set[int]:
    """The most harmful relation at each of these primitives, at most one to a primitive."""
    dropped: set[int] = set()
    done: set[int] = set()
    for k in (given + np.argsort(-harm[given:])).tolist():
        ends = set(relations[k].members)
        if ends & places and not ends & done:
            dropped.add(k)
            done |= ends
    return dropped
