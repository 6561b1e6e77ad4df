"""Which kind of primitive, quickly: the refinement asks this thousands of times."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Primitive, side_of
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.refine import refine
from sed2cad.primitives.registry import primitive_class
from sed2cad.primitives.robust_fit import evenly, thinned
from sed2cad.primitives.starts import starts
from sed2cad.primitives.tensor_patch import TensorPatch
from sed2cad.segmentation.corners import Corners
from sed2cad.segmentation.energy import Tolerances, cost_of

Array = NDArray[np.float64]

MOST_POINTS = 240
NUMBER = 0.75  # price of a number that shapes or places a surface, per log n; smoothing ties half of a spline's
LIKELY = 0.5
NEAR = 2.0  # mean data cost of a kind that may be the right one
_HOPELESS = 5.0  # mean data cost of a kind that no surface near by turns into the right one
SIMPLE_FIRST = ("plane", "cylinder", "sphere", "cone", "torus")
ONE_BAND = ("plane", "cylinder", "cone", "sphere", "torus")  # on two circles lies a sphere too, but a cone is meant


@dataclass(frozen=True)
class Choice:
    """A primitive, the side of it that is outside (sign), its data cost over the points, and what its numbers cost
    (Schwarz 1978, with a stricter price than his)."""

    primitive: Primitive
    sign: int
    cost: float
    price: float


@dataclass(frozen=True)
class Case:
    """Points of what may be one surface, no more than it takes to choose its kind."""

    points: Array  # (m, 3)
    normals: Array  # (m, 3)
    count: int  # of the points that they stand for
    tolerances: Tolerances
    freeform: float = 0.0  # probability that no analytic kind is meant
    corners: Corners | None = None  # on a mesh of a CAD system

    @classmethod
    def of(
        cls, points: Array, normals: Array, tolerances: Tolerances, freeform: float = 0.0,
        corners: Corners | None = None,
    ) -> Case:
        """That of points (n, 3)."""
        count = len(points)
        if corners is not None:
            corners = corners[evenly(count, min(count, MOST_POINTS))].alone()
        return cls(*thinned(points, normals, MOST_POINTS), count, tolerances, freeform, corners)


def choose(case: Case) -> Choice | None:
    """The kind of least data cost + price.

    Simple kinds first; a kind that leaves nothing to explain ends the search. A B-spline is tried where the analytic
    kinds leave much and the points are likely to be freeform.
    """
    points, normals, tolerances, corners = case.points, case.normals, case.tolerances, case.corners
    best: Choice | None = None
    least = np.inf
    for kind in SIMPLE_FIRST if corners is None else ONE_BAND:
        freedom = primitive_class(kind).freedom
        if freedom >= len(points):
            continue
        found = _fit(kind, points, normals, tolerances, corners)
        if found is None:
            continue
        if found.cost + found.price < least:
            best, least = found, found.cost + found.price
        explained = best is not None and best.cost < (0.5 if kind == "plane" else 0.7) * len(points)
        if explained or (best is found and corners is not None and corners.settle(found.primitive)):
            break
    if case.freeform > LIKELY and len(points) >= 16 and (best is None or best.cost > 1.5 * len(points)):
        surface = fit_bspline(points, normals, tolerances.distance)
        rated = None if surface is None else _rate(surface, points, normals, tolerances, corners)
        if rated is not None and (best is None or rated.cost < 0.7 * best.cost):
            best = rated
    return best and replace(best, cost=best.cost * case.count / len(points))


def plausible(points: Array, normals: Array, tolerances: Tolerances) -> list[str]:
    """The kinds that come near points (n, 3) and their normals: worth a careful fit."""
    points, normals = thinned(points, normals, MOST_POINTS)
    near = []
    for kind in SIMPLE_FIRST:
        found = _fit(kind, points, normals, tolerances) if primitive_class(kind).freedom < len(points) else None
        if found is not None and found.cost < NEAR * len(points):
            near.append(kind)
    return near


def _fit(
    kind: str, points: Array, normals: Array, tolerances: Tolerances, corners: Corners | None = None
) -> Choice | None:
    """The best algebraic start, a few steps downhill; through the vertices where that costs less."""
    trials = [_rate(start, points, normals, tolerances) for start in starts(kind, points, normals)]
    if not trials:
        return None
    best = min(trials, key=lambda trial: trial.cost).primitive
    found = _rate(refine(best, points, tolerances.distance, steps=5), points, normals, tolerances)
    if corners is None:
        return found
    exact = corners.moved(found.primitive) if found.cost < _HOPELESS * len(points) else None
    both = [trial for trial in (found.primitive, exact) if trial is not None]
    found = min((_rate(trial, points, normals, tolerances, corners) for trial in both), key=lambda trial: trial.cost)
    return None if corners.through_any(found.primitive) else found


def _rate(
    primitive: Primitive, points: Array, normals: Array, tolerances: Tolerances, corners: Corners | None = None
) -> Choice:
    distance, there = primitive.distance_and_normal(points)
    sign = side_of(there, normals)
    cost = float(cost_of(primitive, distance, sign * there, normals, tolerances, corners).sum())
    numbers = primitive.shape_numbers / 2 if isinstance(primitive, TensorPatch) else primitive.freedom
    return Choice(primitive, sign, cost, NUMBER * numbers * float(np.log(len(points))))
