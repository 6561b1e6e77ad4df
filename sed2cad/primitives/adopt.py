"""Short arcs that hardly tell their axis, or tell a wrong one, take one of the part where their points allow it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.coaxial import coaxial
from sed2cad.primitives.proposals import DIRECTION, Piece, Pieces
from sed2cad.primitives.relations import placement

_KINDS = ("cylinder", "cone", "torus")
_VAGUE = np.radians(3.0)  # deviation of a direction that needs help, and a turn that leads out of its valley
_SURE = np.radians(1.0)  # of one that can give it
_CHANCE = 9.0  # growth of chi^2 that four numbers given up explain


def adopt_axes(pieces: Pieces) -> tuple[Pieces, dict[int, int]]:
    """The pieces, those with vague axes about the sure axis that fits them best, if any does; and whose that is.

    So are cones that have settled in another valley: on a short arc the points are as near to cones about quite
    different axes, and the covariance knows of one of them only. A sure cone leans on better known axes alone.
    """
    spread = {k: p.spread(DIRECTION) for k, p in pieces.items() if p.primitive.kind in _KINDS}
    sure = [k for k in sorted(spread, key=lambda k: spread[k]) if spread[k] < _SURE]
    changed = dict(pieces)
    hosts: dict[int, int] = {}
    for index in sorted(spread, key=lambda k: spread[k]):
        piece, is_vague = pieces[index], spread[index] > _VAGUE
        if not is_vague and piece.primitive.kind != "cone":
            continue
        better = sure[: sure.index(index)] if index in sure else sure
        found = _adopted(piece, [placement(changed[k].primitive) for k in better])
        if found is not None and (is_vague or _turned(piece.primitive, found[0]) > _VAGUE):
            host = better[found[1]]
            changed[index], hosts[index] = replace(piece, primitive=found[0]), hosts.get(host, host)
    return changed, hosts


def _turned(before: Primitive, after: Primitive) -> float:
    """Angle between the undirected axes, radians."""
    cosine = abs(float(placement(before)[:3] @ placement(after)[:3]))
    return float(np.arccos(min(cosine, 1.0)))


def _adopted(piece: Piece, axes: list[Array]) -> tuple[Primitive, int] | None:
    """The primitive about the best of the axes, and which that is; None where the points do not allow it."""
    trials = [_about_axis(piece, place[3:6], place[:3]) for place in axes]
    costs = [np.inf if trial is None else piece.evidence.chi_square(trial) for trial in trials]
    best = int(np.argmin(costs)) if costs else -1
    chosen = trials[best] if costs else None
    if chosen is None or costs[best] > piece.evidence.chi_square(piece.primitive) + _CHANCE:
        return None
    return chosen, best


def _about_axis(piece: Piece, origin: Array, axis: Array) -> Primitive | None:
    """The primitive of the same kind about an axis that is nearest to the points and the normals of the fit."""
    points, turns = piece.evidence.points, piece.evidence.turns
    normals = piece.primitive.normal(points) if turns is None else turns.normals
    return coaxial(piece.primitive.kind, axis, origin, points, normals)
