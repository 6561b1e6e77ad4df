"""Short arcs that hardly tell their axis, or tell a wrong one, take one of the part where their points allow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.proposals import DIRECTION, Piece, Pieces
from sed2cad.primitives.relations import placement
from sed2cad.primitives.starts import is_proper, torus_about
from sed2cad.primitives.vectors import about_axis, unit

_VAGUE = np.radians(3.0)  # deviation of a direction that needs help, and a turn that leads out of its valley
_SURE = np.radians(1.0)  # of one that can give it
_CHANCE = 9.0  # growth of chi^2 that four numbers given up explain


def adopt_axes(pieces: Pieces) -> tuple[Pieces, dict[int, int]]:
    """The pieces, those with vague axes about the sure axis that fits them best, if any does; and whose that is.

    So are cones that have settled in another valley: on a short arc the points are as near to cones about quite
    different axes, and the covariance knows of one of them only. A sure cone leans on better known axes alone.
    """
    spread = {k: p.spread(DIRECTION) for k, p in pieces.items() if p.primitive.kind in _ABOUT}
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
    found = _ABOUT[piece.primitive.kind](axis, origin, points, normals)
    return found if found is not None and is_proper(found) else None


def _cylinder(axis: Array, origin: Array, points: Array, normals: Array) -> Primitive:
    height, radius, _ = about_axis(points, origin, axis)
    return Cylinder(axis, origin + height.mean() * axis, float(radius.mean()))


def _cone(axis: Array, origin: Array, points: Array, normals: Array) -> Primitive | None:
    """A line in the half plane (radius, height), through the middle and across the mean normal."""
    heights, radii, radial = about_axis(points, origin, axis)
    arrows = unit(np.column_stack([np.einsum("ij,ij->i", normals, radial), normals @ axis]))
    radius, height, (out, up) = radii.mean(), heights.mean(), unit(arrows.mean(axis=0))
    slope = -up / out if abs(out) > 1e-3 else np.inf  # growth of the radius along the axis
    if not 1e-4 < abs(slope) < 1e3:
        return None
    apex = origin + (height - radius / slope) * axis
    return Cone(axis if slope > 0 else -axis, apex, float(np.arctan(abs(slope))), float(radius / abs(slope)))


_ABOUT: dict[str, Callable[[Array, Array, Array, Array], Primitive | None]] = {
    "cylinder": _cylinder,
    "cone": _cone,
    "torus": torus_about,
}
"""Direction and origin (3,) of the axis, points (n, 3) and normals (n, 3)."""
