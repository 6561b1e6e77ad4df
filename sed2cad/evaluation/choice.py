"""Whether the right kind is chosen where the points can tell it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sed2cad.evaluation.true_patches import (
    TruePatch,
    cone_points,
    cylinder_points,
    placed,
    sphere_points,
    torus_points,
)
from sed2cad.fitting import select
from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.refine import refine
from sed2cad.primitives.registry import ANALYTIC_KINDS, primitive_class
from sed2cad.primitives.starts import starts

DISTINGUISHABLE = 5.0  # sigma
STRENGTHS = (6.0, 8.0, 12.0, 20.0, 50.0)  # sigma, of the ladder
_LADDER_NOISE = 0.001
_POINTS = 500  # that tell the strength


@dataclass(frozen=True)
class ChoiceScores:
    """Choices between all kinds for patches of one true kind."""

    kind: str
    case: str
    noise: float
    count: int
    strength: float  # sigma by which the truth differs from the best simpler kind; infinite for a plane
    right: int
    total: int
    instead: tuple[str, ...]  # what was chosen where that was wrong


def choose(kind: str, case: str, noise: float, patches: Sequence[TruePatch]) -> ChoiceScores:
    """Choose for patches of one population; its first one tells the strength."""
    first = patches[0]
    assert first.primitive is not None
    strength = distinction(first.primitive, first.feet, noise)
    chosen = [select(patch.points, patch.normals, noise) for patch in patches]
    kinds = ["none" if found is None else found.primitive.kind for found in chosen]
    wrong = tuple(other for other in kinds if other != kind)
    count = len(first.points)
    return ChoiceScores(kind, case, noise, count, strength, len(kinds) - len(wrong), len(kinds), wrong)


def distinction(truth: Primitive, feet: Array, noise: float) -> float:
    """How far the feet (n, 3) are from the best surface of a simpler kind: root of chi^2, in sigma.

    For a parameter that a simpler kind has not (the curvature of a cylinder that is nearly a plane), this is the
    parameter over its Cramer-Rao bound as long as it is small; it needs no name for the parameter, and no formula for
    each pair of kinds.
    """
    few = feet[np.linspace(0, len(feet) - 1, min(len(feet), _POINTS)).astype(np.int64)]
    normals = truth.normal(few)
    simpler = [kind for kind in ANALYTIC_KINDS if primitive_class(kind).freedom < truth.freedom]
    squares = [
        float(np.mean(refine(start, few, 0.0, steps=15, robust=False).distance(few) ** 2))
        for kind in simpler
        for start in starts(kind, few, normals)
    ]
    return float(np.sqrt(min(squares) * len(feet)) / noise) if squares else float("inf")


def ladder(seeds: int, counts: Sequence[int], strengths: Sequence[float] = STRENGTHS) -> list[ChoiceScores]:
    """Kinds that differ from a simpler one by a few sigma.

    With thousands of points this is a fraction of the noise at each of them. `select` calls that the simpler kind on
    purpose, since real scans err together over a patch; the ladder shows what this costs where errors are independent.
    """
    return [
        choose(kind, case, _LADDER_NOISE, _rung(family, start, strength, count, seeds))
        for kind, case, start, family in _FAMILIES
        for count in counts
        for strength in strengths
    ]


_Family = Callable[[np.random.Generator, int, float], tuple[Primitive, Array, Array]]


def _rung(family: _Family, size: float, strength: float, count: int, seeds: int) -> list[TruePatch]:
    """Patches of a family at a given distinction, which grows about as the number that distinguishes them."""
    for _ in range(4):
        truth, feet, _ = family(np.random.default_rng(1), 2000, size)
        size *= strength / (distinction(truth, feet, _LADDER_NOISE) * np.sqrt(count / 2000))
    patches = []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, count, round(strength)])
        patches.append(placed(*family(rng, count, size), _LADDER_NOISE, 0.0, rng))
    return patches


def _bent_strip(rng: np.random.Generator, count: int, curvature: float) -> tuple[Primitive, Array, Array]:
    """A strip of a cylinder, 0.5 x 0.5."""
    curvature = min(curvature, 6.0)
    return cylinder_points(rng, count, np.degrees(0.5 * curvature), 1 / curvature, 0.5)


def _cap(rng: np.random.Generator, count: int, curvature: float) -> tuple[Primitive, Array, Array]:
    """A cap of a sphere, 0.5 across."""
    curvature = min(curvature, 6.0)
    return sphere_points(rng, count, np.degrees(0.5 * curvature), 1 / curvature)


def _taper(rng: np.random.Generator, count: int, half_angle: float) -> tuple[Primitive, Array, Array]:
    """Half a cylinder with a draft, radius 0.25 and height 0.6."""
    half_angle = min(half_angle, 0.35)
    reach = 0.25 / np.tan(half_angle)
    return cone_points(rng, count, 180.0, half_angle, -reach, reach - 0.3, reach + 0.3)


def _bent_tube(rng: np.random.Generator, count: int, curvature: float) -> tuple[Primitive, Array, Array]:
    """Half a tube of radius 0.15 and length 0.6, bent."""
    curvature = min(curvature, 3.0)
    return torus_points(rng, count, np.degrees(0.6 * curvature), 180.0, 1 / curvature, 0.15)


def _split_ball(rng: np.random.Generator, count: int, major: float) -> tuple[Primitive, Array, Array]:
    """A quarter of a ball, moved off the axis that it is turned about."""
    return torus_points(rng, count, 180.0, 90.0, min(major, 0.3), 0.3)


_FAMILIES: tuple[tuple[str, str, float, _Family], ...] = (
    ("cylinder", "nearly a plane", 0.3, _bent_strip),
    ("sphere", "nearly a plane", 0.3, _cap),
    ("cone", "nearly a cylinder", 0.05, _taper),
    ("torus", "nearly a cylinder", 0.3, _bent_tube),
    ("torus", "nearly a sphere", 0.05, _split_ball),
)
