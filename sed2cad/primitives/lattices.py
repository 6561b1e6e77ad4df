"""Circles, rows and grids in the plane that places lie on by more than chance.

A pattern counts when so many places on it would be expected less than once in `_CHANCE` drawings of places at
random: the number of ways to pick it times the odds of every coordinate that it predicts (Desolneux, Moisan and
Morel 2000, Meaningful alignments).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Array

_CHANCE = 1e-4
_TOLERANCE = (1e-4, 4e-3)  # least and most that places are moved by, unit frame
_FULL = 0.5  # least share of the places of a pattern that are taken
_MOST_TURNS = 24  # holes on a bolt circle
_MOST_TRIPLES = 1500  # places that are tried as three of a circle
_NEAREST = 8  # neighbours that are tried at a distance of one pitch

Steps = NDArray[np.int64]


@dataclass(frozen=True)
class Lattice:
    """Places at whole steps of a turn about a centre, or of one or two pitches from an origin."""

    members: Steps  # (k,) indices of places
    steps: Steps  # (k, 1) turns, or pitches of a row, or (k, 2) pitches of a grid
    origin: Array  # (2,) centre, or where the steps are 0
    pitch: Array  # (1, 2) or (2, 2) vectors; of a circle from the centre to step 0
    turns: int = 0  # of a circle: how many steps make a full turn
    chance: float = 0.0  # how many as good ones to expect where places are random

    @property
    def merit(self) -> tuple[int, float]:
        """More members, then less by chance."""
        return len(self.members), -self.chance


def tolerances(spread: Array | float) -> Array:
    """Three standard deviations, but within limits."""
    return np.clip(3 * spread, *_TOLERANCE)


def tolerance(spread: float) -> float:
    """The same for one."""
    return float(tolerances(spread))


def is_known(spread: float) -> bool:
    """Whether it is so small that the tolerance is not cut off."""
    return 3 * spread < _TOLERANCE[1]


def best_lattice(places: Array, spread: Array, centres: Array, centre_spread: Array) -> Lattice | None:
    """The best circle, row or grid of places (n, 2) with their standard deviations (n,).

    Circles may have one of the centres (m, 2). None where nothing is beyond chance.
    """
    found = [*_circles(places, spread, centres, centre_spread), *_grids(places, spread)]
    return max((f for f in found if f.chance < _CHANCE), key=lambda f: f.merit, default=None)


def _circles(places: Array, spread: Array, centres: Array, centre_spread: Array) -> Iterator[Lattice]:
    """One candidate for each centre that is given or that three places have."""
    for centre, sigma in zip(centres, centre_spread):
        radii = np.linalg.norm(places - centre, axis=1)
        for first in range(len(places)):
            if radii[first] > 10 * _TOLERANCE[0]:
                yield from _circle(places, spread, centre, first, float(sigma))
    triples = np.array(list(combinations(range(len(places)), 3)), np.int64).reshape(-1, 3)
    triples = triples[np.linspace(0, len(triples) - 1, min(len(triples), _MOST_TRIPLES)).astype(np.int64)]
    for triple in triples:
        around = _circumcentre(places[triple])
        if around is not None:
            yield from _circle(places, spread, around, int(triple[0]), None)


def _circumcentre(corners: Array) -> Array | None:
    """Of a triangle (3, 2); None where it is too flat for a pattern of at most _MOST_TURNS."""
    edges = corners[1:] - corners[0]
    squares = (edges**2).sum(axis=1)
    twice_area = abs(float(np.linalg.det(edges)))
    if twice_area < 0.05 * squares.max():
        return None
    return np.asarray(corners[0] + np.linalg.solve(2 * edges, squares))


def _circle(places: Array, spread: Array, centre: Array, first: int, known: float | None) -> Iterator[Lattice]:
    """The circle through the place `first`, with the number of turns that suits the most places."""
    offset = places - centre
    radii, angles = np.linalg.norm(offset, axis=1), np.arctan2(offset[:, 1], offset[:, 0])
    slack = tolerances(np.hypot(np.hypot(spread, spread[first]), known or 0.0))
    ring = np.flatnonzero(np.abs(radii - radii[first]) < slack)
    if len(ring) < 3:
        return
    counts = np.arange(3, _MOST_TURNS + 1)
    turned = (angles[ring] - angles[first])[:, None] * counts / (2 * np.pi)  # (ring, counts)
    steps = np.round(turned).astype(np.int64)
    near = np.abs(turned - steps) * (2 * np.pi / counts) * radii[first] < slack[ring][:, None]
    taken = near.sum(axis=0)
    best = int(np.argmax(np.where(taken >= _FULL * counts, taken, 0)))
    turns, chosen = int(counts[best]), ring[near[:, best]]
    steps = steps[near[:, best], best] % turns
    if len(chosen) < 3 or len(np.unique(steps)) < len(chosen) or len(chosen) < _FULL * turns:
        return
    checks = 2 * len(chosen) - (2 if known is not None else 4)
    odds = 2 * float(slack[chosen].mean()) / radii[first]
    ways = comb(len(places), 1 if known is not None else 3) * len(counts)
    angle = 2 * np.pi / turns * steps
    cosine, sine, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(steps)), np.ones(len(steps))
    design = np.vstack([np.column_stack([one, zero, cosine, -sine]), np.column_stack([zero, one, sine, cosine])])
    fit = _fit(design, places[chosen].T.ravel(), np.tile(spread[chosen], 2))
    if fit is not None:
        yield Lattice(chosen, steps[:, None], fit[:2], fit[None, 2:], turns, ways * min(odds, 1.0) ** checks)


def _grids(places: Array, spread: Array) -> Iterator[Lattice]:
    """Rows and rectangular grids; two near neighbours of a place give the pitches."""
    for first in range(len(places)):
        offset = places - places[first]
        length = np.linalg.norm(offset, axis=1)
        near = [k for k in np.argsort(length, kind="stable")[1 : 1 + _NEAREST] if length[k] > 10 * _TOLERANCE[0]]
        for u in near:
            yield from _grid(places, spread, first, offset[[u]])
        slack = tolerances(spread)
        for u, v in combinations(near, 2):
            lean = abs(offset[u] @ offset[v]) / max(length[u], length[v])
            if lean < np.hypot(slack[u], slack[v]):
                yield from _grid(places, spread, first, offset[[u, v]])


def _grid(places: Array, spread: Array, first: int, pitch: Array) -> Iterator[Lattice]:
    """The row or grid with this pitch (1, 2) or (2, 2) from the place `first`."""
    offset, length = places - places[first], np.linalg.norm(pitch, axis=1)
    along = offset @ (pitch / length[:, None]).T  # (n, 1 or 2), lengths
    steps = np.round(along / length).astype(np.int64)
    reach = np.sqrt(1 + 2 * (steps**2).sum(axis=1))  # errors of the pitch grow with the steps
    slack = tolerances(spread * reach)
    fits = (np.abs(along - steps * length) < slack[:, None]).all(axis=1)
    if len(pitch) == 1:
        fits &= np.linalg.norm(offset - along @ (pitch / length[:, None]), axis=1) < slack
    chosen = np.flatnonzero(fits)
    steps = steps[chosen] - steps[chosen].min(axis=0)
    extent = steps.max(axis=0)
    if len(chosen) < 2 + len(pitch) or (extent < 1).any() or len(np.unique(steps, axis=0)) < len(chosen):
        return
    if len(chosen) < _FULL * np.prod(extent + 1):
        return
    checks = 2 * len(chosen) - (4 if len(pitch) == 1 else 5)
    odds = 2 * float(slack[chosen].mean()) / float(length.min())
    ways = comb(len(places), 1 + len(pitch))
    blocks = [np.kron(np.eye(2), np.column_stack([np.ones(len(chosen)), steps]))]
    fit = _fit(np.vstack(blocks), places[chosen].T.ravel(), np.tile(spread[chosen], 2))
    if fit is not None:
        x, y = np.split(fit, 2)
        pitch = np.column_stack([x[1:], y[1:]])
        yield Lattice(chosen, steps, np.array([x[0], y[0]]), pitch, 0, ways * min(odds, 1.0) ** checks)


def _fit(design: Array, values: Array, spread: Array) -> Array | None:
    """Weighted least squares; None where a value is left too far off."""
    weight = 1 / np.maximum(spread, 1e-6)
    fit = np.asarray(np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0], float)
    return fit if (np.abs(design @ fit - values) < tolerances(spread)).all() else None
