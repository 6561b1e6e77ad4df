"""Dimensions that become multiples of a step where the points allow it.

All dimensions are measured on primitives that obey their relations already. A dimension that follows from the
relations and from dimensions that were rounded before is none of its own: that is linear algebra, and so is the
uncertainty that the relations and the rounding before leave it (a Kalman filter without dynamics).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.primitives.base import Array
from sed2cad.primitives.patterns import Datum
from sed2cad.primitives.proposals import Pieces
from sed2cad.primitives.relations import Equation, Placed, Stack, dot, placement
from sed2cad.primitives.settle import primitives_of
from sed2cad.primitives.solve_relations import Relation, by_equation, fit_terms, layout_of, linearised, null_space

_INDEPENDENT = 50  # points that err independently, as for the proposals
_DEGREES = 0.5  # angles become multiples of it
_UNSEEN = (5e-5, np.radians(0.01))  # changes that are always allowed: unit frame, radians
_MOST_SIGMAS = 10.0  # but not of more standard deviations than this
_IMPLIED = 1e-3  # share of a dimension's own standard deviation that is left to it where others fix it
_LOOSE = 0.1  # standard deviation of what no point holds, radians or unit lengths
_ALIGNED = 1e-9  # of directions that relations made parallel or perpendicular


@dataclass(frozen=True)
class Dimension:
    """A number that a designer would write at the part; radians or unit frame."""

    measure: str  # radius, major_radius, minor_radius, half_angle, distance, angle, pitch, pitch_radius
    members: tuple[int, ...]  # that it is a dimension of
    relation: Relation  # number: the value that it is to have
    rank: int = 0  # those of lower rank are rounded first
    before: float = np.nan

    @property
    def after(self) -> float:
        """The value once the relation holds."""
        return self.relation.number


def propose_dimensions(pieces: Pieces, relations: Sequence[Relation], step: float) -> list[Dimension]:
    """Dimensions with the multiples of the step (unit frame) that they may become, the best known first.

    `pieces` obey the relations already. What is so uncertain that any of several multiples would do is left alone.
    """
    found = [*_sizes(pieces), *_angles(pieces), *_distances(pieces)]
    if not found:
        return []
    values, rows = _measured(pieces, relations, [dimension.relation for dimension in found])
    spread = np.linalg.norm(rows, axis=1)
    order = sorted(range(len(found)), key=lambda k: (found[k].rank, spread[k]))
    state, base = np.zeros(rows.shape[1]), np.zeros((0, rows.shape[1]))
    rounded = []
    for k in order:
        free = rows[k] - (rows[k] @ base.T) @ base
        left = float(np.linalg.norm(free))
        if left < _IMPLIED * spread[k] or spread[k] == 0:
            continue
        angular = found[k].measure in ("angle", "half_angle")
        grid, value = np.radians(_DEGREES) if angular else step, values[k] + rows[k] @ state
        number, limit = float(np.round(value / grid) * grid), max(3 * left, min(_UNSEEN[angular], _MOST_SIGMAS * left))
        if number == 0 or abs(number - value) > limit or spread[k] > grid / 2:
            continue
        state, base = state + free * (number - value) / left**2, np.vstack([base, free / left])
        relation = replace(found[k].relation, number=number, strain=abs(number - value) / limit)
        rounded.append(replace(found[k], relation=relation, before=float(values[k])))
    return rounded


def _measured(
    pieces: Pieces, relations: Sequence[Relation], dimensions: Sequence[Relation]
) -> tuple[Array, Array]:
    """Values (k,) of the dimensions, and their derivatives (k, free) by independent changes of unit variance."""
    primitives = primitives_of(pieces)
    layout = layout_of(primitives, [*relations, *dimensions])
    evidence = {index: pieces[index].evidence for index in layout}
    hessian = fit_terms(primitives, evidence, layout)[0]
    for index, part in layout.items():
        hessian[part, part] /= max(1.0, len(evidence[index].points) / _INDEPENDENT)
    free = null_space(linearised(primitives, relations, layout)[1])
    held = free.T @ hessian @ free + np.eye(free.shape[1]) / _LOOSE**2
    values, rows, _ = linearised(primitives, dimensions, layout)
    order = np.argsort([k for members in by_equation(dimensions).values() for k in members])
    values, rows = values[order], rows[order]
    return values, np.linalg.solve(np.linalg.cholesky(held), (rows @ free).T).T


def _sizes(pieces: Pieces) -> Iterator[Dimension]:
    for index, entry in pieces.items():
        kind = entry.primitive.kind
        if isinstance(entry, Datum):
            if entry.measure:
                yield _dimension(entry.measure, (index,), _size)
        elif kind in ("cylinder", "sphere"):
            yield _dimension("radius", (index,), _size)
        elif kind == "cone":
            yield _dimension("half_angle", (index,), _size)
        elif kind == "torus":
            yield _dimension("major_radius", (index,), _size)
            yield _dimension("minor_radius", (index,), _second)


def _angles(pieces: Pieces) -> Iterator[Dimension]:
    """Between the planes of every two directions."""
    planes = [group[0] for group in _plane_groups(pieces)]
    for k, a in enumerate(planes):
        for b in planes[:k]:
            if abs(_direction(pieces, a) @ _direction(pieces, b)) > _ALIGNED:
                yield _dimension("angle", (a, b), _angle)


def _distances(pieces: Pieces) -> Iterator[Dimension]:
    """Along the normals of planes; between axes, where that does not tell."""
    for group in _plane_groups(pieces):
        normal = _direction(pieces, group[0])
        for k, a in enumerate(group):
            yield from (_dimension("distance", (a, b), _plane_gap) for b in group[:k])
        level = [index for index in pieces if index not in group and _has_level(pieces, index, normal)]
        for k, a in enumerate(level):
            yield from (_dimension("distance", (plane, a), _height, 1) for plane in group)
            for b in level[:k]:
                relation = Relation("rounded", (group[0], b, a), _rise, 0.0)
                yield Dimension("distance", (b, a), relation, 1)
    axes = [
        index
        for index, entry in pieces.items()
        if entry.primitive.kind in ("cylinder", "cone") and not _is_abstract(pieces, index)
    ]
    for k, a in enumerate(axes):
        for b in axes[:k]:
            p, q = placement(pieces[a].primitive), placement(pieces[b].primitive)
            apart = np.linalg.norm(np.cross(p[3:6] - q[3:6], p[:3]))
            if apart > _UNSEEN[0] and np.linalg.norm(np.cross(p[:3], q[:3])) < _ALIGNED:
                yield _dimension("distance", (b, a), _axis_gap, 2)


def _dimension(measure: str, members: tuple[int, ...], equation: Equation, rank: int = 0) -> Dimension:
    return Dimension(measure, members, Relation("rounded", members, equation, 0.0), rank)


def _plane_groups(pieces: Pieces) -> list[list[int]]:
    """Planes with one normal."""
    groups: list[list[int]] = []
    for index, entry in pieces.items():
        if entry.primitive.kind != "plane" or isinstance(entry, Datum):
            continue
        for group in groups:
            if np.linalg.norm(np.cross(_direction(pieces, group[0]), _direction(pieces, index))) < _ALIGNED:
                group.append(index)
                break
        else:
            groups.append([index])
    return groups


def _has_level(pieces: Pieces, index: int, normal: Array) -> bool:
    """Whether it has one place along the normal: centres do, and axes across it."""
    if _is_abstract(pieces, index):
        return False
    kind, direction = pieces[index].primitive.kind, _direction(pieces, index)
    across = abs(float(direction @ normal))
    if kind == "torus":
        return min(across, float(np.linalg.norm(np.cross(direction, normal)))) < _ALIGNED
    return kind == "sphere" or (kind in ("cylinder", "cone") and across < _ALIGNED)


def _is_abstract(pieces: Pieces, index: int) -> bool:
    entry = pieces[index]
    return isinstance(entry, Datum) and not entry.placed


def _direction(pieces: Pieces, index: int) -> Array:
    return placement(pieces[index].primitive)[:3]


def _size(p: Placed, s: Stack) -> Stack:
    return (p.size - s)[:, None]


def _second(p: Placed, s: Stack) -> Stack:
    return (p.second - s)[:, None]


def _plane_gap(p: Placed, q: Placed, s: Stack) -> Stack:
    """From q to p along the normal of p; they are parallel."""
    return (p.size - dot(p.direction, q.direction) * q.size - s)[:, None]


def _height(p: Placed, q: Placed, s: Stack) -> Stack:
    """Of a centre or an axis over a plane."""
    return (dot(p.direction, q.position) - p.size - s)[:, None]


def _rise(p: Placed, q: Placed, r: Placed, s: Stack) -> Stack:
    """From q to r along the normal of p."""
    return (dot(p.direction, r.position - q.position) - s)[:, None]


def _axis_gap(p: Placed, q: Placed, s: Stack) -> Stack:
    """Between parallel axes."""
    apart = np.cross(q.position - p.position, p.direction)
    return (np.sqrt(dot(apart, apart)) - s)[:, None]


def _angle(p: Placed, q: Placed, s: Stack) -> Stack:
    return (np.arccos(dot(p.direction, q.direction)) - s)[:, None]
