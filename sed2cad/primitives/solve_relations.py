"""Primitives that obey relations exactly and otherwise stay as near to their points as they can."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.refine import normal_jacobian
from sed2cad.primitives.relations import (
    PLACEMENT,
    Equation,
    placement,
    placement_jacobian,
    residual_jacobian,
    residuals,
)
from sed2cad.primitives.starts import is_proper

_STEPS = 12  # towards relations and points
_LAST_STEPS = 5  # towards the relations alone
_HELD_BACK = 0.02  # standard deviation of one step, radians or unit lengths
_LARGEST_STEP = 0.05  # radians or unit lengths
_EXACT = 1e-12
_DEPENDENT = 1e-4  # a row of the constraints that adds less than this is implied by the others


@dataclass(frozen=True)
class Relation:
    """What primitives are to each other."""

    kind: str
    members: tuple[int, ...]  # indices of the primitives that the equation calls p, q, ...
    equation: Equation
    number: float = 1.0  # a sign, or the angle or length that the equation is about
    strain: float = 0.0  # violation before, in units of what is tolerated


@dataclass(frozen=True)
class Turns:
    """Normals that hold a primitive in place, weighed where the fit put it."""

    normals: Array  # (n, 3) as the primitive's point
    weights: Array  # (n,)
    whitening: Array  # (n, 3, 3) of their gaps, see Directions

    def gaps(self, primitive: Primitive, points: Array) -> Array:
        """Whitened (n, 3)."""
        return np.asarray(np.einsum("nij,nj->ni", self.whitening, primitive.normal(points) - self.normals))

    def terms(self, primitive: Primitive, points: Array) -> tuple[Array, Array]:
        """Their share of Evidence.terms.

        The slopes are those of the primitive as it is now: where a radius is hardly above the noise, a step of one
        deviation turns the normals so much that slopes from before lead uphill.
        """
        is_flat = isinstance(primitive, Plane)
        turning = placement_jacobian(primitive)[:3] if is_flat else normal_jacobian(primitive, points)
        slopes = self.whitening @ turning
        rows = slopes.reshape(-1, slopes.shape[2])
        weighted = (slopes * self.weights[:, None, None]).reshape(rows.shape)
        return rows.T @ weighted, self.gaps(primitive, points).ravel() @ weighted


@dataclass(frozen=True)
class Evidence:
    """Points that hold a primitive in place, and perhaps their normals."""

    points: Array  # (n, 3)
    weights: Array  # (n,), 1 / variance
    turns: Turns | None = None

    def chi_square(self, primitive: Primitive) -> float:
        """Weighted sum of the squared distances and gaps."""
        squares = float(self.weights @ primitive.distance(self.points) ** 2)
        if self.turns is None:
            return squares
        return squares + float(self.turns.weights @ (self.turns.gaps(primitive, self.points) ** 2).sum(axis=1))

    def terms(self, primitive: Primitive) -> tuple[Array, Array]:
        """Normal matrix (freedom, freedom) and half the gradient (freedom,) of chi_square in the primitive's chart."""
        jacobian = primitive.jacobian(self.points)
        weighted = jacobian * self.weights[:, None]
        hessian, gradient = weighted.T @ jacobian, primitive.distance(self.points) @ weighted
        if self.turns is not None:
            turned, slopes = self.turns.terms(primitive, self.points)
            hessian, gradient = hessian + turned, gradient + slopes
        return hessian, gradient


def satisfy(
    primitives: Mapping[int, Primitive], relations: Sequence[Relation], evidence: Mapping[int, Evidence]
) -> dict[int, Primitive]:
    """Null-space Gauss-Newton over all related primitives; the others are returned as they are.

    Where relations contradict each other the less strained ones are met: check `violations` of the result.
    """
    current = dict(primitives)
    layout = layout_of(current, relations)
    history: list[float] = []
    for turn in range(_STEPS + _LAST_STEPS):
        values, rows, trust = linearised(current, relations, layout)
        history.append(float(np.abs(values).max(initial=0.0)))
        if turn > 7 and history[-1] > max(1e-6, 0.8 * history[-5]):
            break  # a contradiction
        hessian, gradient = fit_terms(current, evidence, layout)
        onto, along = _null_space_steps(hessian, gradient, rows * trust[:, None], values * trust)
        current = _moved(current, _shortened(onto + along if turn < _STEPS else onto), layout)
        resting = turn >= _STEPS or np.abs(along).max(initial=0.0) < 1e-6
        if resting and history[-1] < _EXACT:
            break
    return current


def _shortened(step: Array) -> Array:
    """No longer than trusted, and as a whole: one part of it takes back what the other does to the points."""
    return step * min(1.0, _LARGEST_STEP / max(float(np.abs(step).max(initial=0.0)), 1e-300))


def members_of(relations: Iterable[Relation]) -> set[int]:
    """All primitives that the relations are about."""
    return {index for relation in relations for index in relation.members}


def violations(primitives: Mapping[int, Primitive], relations: Sequence[Relation]) -> Array:
    """The largest residual of each relation (k,)."""
    found, placements = np.zeros(len(relations)), _placements(primitives, relations)
    for equation, members in by_equation(relations).items():
        sides = _sides(placements, [relations[k] for k in members])
        found[members] = np.abs(residuals(equation, *sides)).max(axis=1)
    return found


def tensions(
    before: Mapping[int, Primitive],
    after: Mapping[int, Primitive],
    relations: Sequence[Relation],
    evidence: Mapping[int, Evidence],
) -> Array:
    """Work (k,) that each relation did against the points: its multipliers times what it has moved.

    About the fall of chi^2 if it were given up.
    """
    layout = layout_of(after, relations)
    moved, rows = linearised(before, relations, layout)[0], linearised(after, relations, layout)[1]
    _, gradient = fit_terms(after, evidence, layout)
    work = np.linalg.lstsq(rows.T, -gradient, rcond=_DEPENDENT)[0] * moved
    found, start = np.zeros(len(relations)), 0
    for members in by_equation(relations).values():
        width = _row_count(relations[members[0]], before)
        share = work[start : start + width * len(members)].reshape(len(members), width)
        found[members] = np.abs(share.sum(axis=1))
        start += width * len(members)
    return found


def layout_of(primitives: Mapping[int, Primitive], relations: Sequence[Relation]) -> dict[int, slice]:
    """Which unknowns belong to which of the related primitives."""
    layout: dict[int, slice] = {}
    start = 0
    for index in sorted(members_of(relations)):
        layout[index] = slice(start, start + primitives[index].freedom)
        start += primitives[index].freedom
    return layout


def _unknowns(layout: dict[int, slice]) -> int:
    return max((part.stop for part in layout.values()), default=0)


def by_equation(relations: Sequence[Relation]) -> dict[Equation, list[int]]:
    """Places in the list of the relations with one equation."""
    groups: dict[Equation, list[int]] = {}
    for k, relation in enumerate(relations):
        groups.setdefault(relation.equation, []).append(k)
    return groups


def _row_count(relation: Relation, primitives: Mapping[int, Primitive]) -> int:
    return residuals(relation.equation, *_sides(_placements(primitives, [relation]), [relation])).shape[1]


def _placements(primitives: Mapping[int, Primitive], relations: Sequence[Relation]) -> dict[int, Array]:
    """The placement (8,) of every related primitive."""
    return {index: placement(primitives[index]) for index in members_of(relations)}


def _sides(placements: Mapping[int, Array], relations: Sequence[Relation]) -> list[Array]:
    """Placements (k, 8) of all first members, all second ones, ..., and the numbers (k,)."""
    members = zip(*(relation.members for relation in relations))
    sides = [np.stack([placements[index] for index in side]) for side in members]
    return [*sides, np.array([relation.number for relation in relations])]


def linearised(
    primitives: Mapping[int, Primitive], relations: Sequence[Relation], layout: dict[int, slice]
) -> tuple[Array, Array, Array]:
    """All residuals (m,), their derivatives (m, unknowns) and trust (m,), equation by equation."""
    charts = {index: placement_jacobian(primitives[index]) for index in layout}
    placements, unknowns = _placements(primitives, relations), _unknowns(layout)
    values, rows, trust = [np.zeros(0)], [np.zeros((0, unknowns))], [np.zeros(0)]
    for equation, members in by_equation(relations).items():
        chosen = [relations[k] for k in members]
        sides = _sides(placements, chosen)
        values.append(residuals(equation, *sides).ravel())
        slopes = residual_jacobian(equation, *sides)
        block = np.zeros((*slopes.shape[:2], unknowns))
        for row, slope, relation in zip(block, slopes, chosen):
            for k, index in enumerate(relation.members):
                row[:, layout[index]] += slope[:, PLACEMENT * k : PLACEMENT * (k + 1)] @ charts[index]
        rows.append(block.reshape(-1, unknowns))
        trust.append(np.repeat([1 / (0.2 + relation.strain) for relation in chosen], slopes.shape[1]))
    return np.concatenate(values), np.vstack(rows), np.concatenate(trust)


def fit_terms(
    primitives: Mapping[int, Primitive], evidence: Mapping[int, Evidence], layout: dict[int, slice]
) -> tuple[Array, Array]:
    """Normal matrix (unknowns, unknowns) and gradient of the weighted squares of the distances."""
    size = _unknowns(layout)
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    for index, part in layout.items():
        hessian[part, part], gradient[part] = evidence[index].terms(primitives[index])
    return hessian, gradient


def _null_space_steps(hessian: Array, gradient: Array, rows: Array, values: Array) -> tuple[Array, Array]:
    """The shortest step that makes values + rows . step zero, and one along the relations.

    The latter leaves the least of the squares; it is held back where the points say next to nothing.
    """
    if not len(gradient):
        return gradient, gradient
    base, triangle, order, rank = _split(rows)
    onto = np.zeros(len(gradient))
    if rank:
        onto = base[:, :rank] @ solve_triangular(triangle[:rank, :rank], -values[order[:rank]], trans="T")
    free = base[:, rank:]
    reduced = free.T @ hessian @ free + np.eye(free.shape[1]) / _HELD_BACK**2
    scale = 1 / np.sqrt(np.diag(reduced))
    pull = scale * (free.T @ (gradient + hessian @ onto))
    along = -free @ (scale * np.linalg.solve(reduced * scale[:, None] * scale, pull))
    return onto, np.asarray(along)


def _split(rows: Array) -> tuple[Array, Array, NDArray[np.int64], int]:
    """Orthonormal base, triangle, order and rank: base[:, :rank] spans the rows, the rest leaves them alone."""
    base, triangle, order = qr(rows.T, pivoting=True)
    pivots = np.abs(np.diag(triangle))
    rank = int((pivots > _DEPENDENT * pivots[0]).sum()) if len(pivots) and pivots[0] > 0 else 0
    return base, triangle, order, rank


def null_space(rows: Array) -> Array:
    """Orthonormal columns (unknowns, free): the changes that keep all of the relations."""
    base, _, _, rank = _split(rows)
    return np.asarray(base[:, rank:])


def _moved(primitives: Mapping[int, Primitive], step: Array, layout: dict[int, slice]) -> dict[int, Primitive]:
    """Every related primitive moved by its part of the step, halved where that would break it."""
    moved = dict(primitives)
    for index, part in layout.items():
        share = step[part]
        for _ in range(8):
            moved[index] = primitives[index].moved(share)
            if is_proper(moved[index]):
                break
            share = share / 2
    return moved
