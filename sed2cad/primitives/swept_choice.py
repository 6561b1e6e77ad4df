"""Whether a freeform patch is really swept: an extrusion, a surface of revolution, or simpler still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.refine import uncertainty, usual_size
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.robust_fit import FINEST, explains, robust_fit, thinned
from sed2cad.primitives.swept_fit import fit_extrusion, fit_revolution

_MOST_POINTS = 3000  # to fit and to judge by
_OUTLIER = 12.0  # chi^2 of a point that belongs elsewhere
_PRICE = 3.0  # of a parameter, in chi^2: more than it gains by following noise
_SLACK = 1.3  # times the noise: what an estimate of it may be wrong by
_TURN = (0.03, 0.2)  # radians: normals may always, and never, be off by this,
_TURNED = 1.3  # else by so many times what the freeform surface leaves
_HALVINGS = 5  # of the points, into pieces whose mean distances tell a surface of the wrong shape
_PIECE = 6  # points, at least
_SURPRISE = 3.5  # standard deviations of chi^2 that noise does not reach
_FINE = 0.3  # square of mean distances that nobody minds, in units of those that scanners make
_SYSTEMATIC = 0.15  # times the noise: mean distances that scanners make


@dataclass(frozen=True)
class Explained:
    """Points and the freeform surface that explains them so far."""

    surface: Primitive
    numbers: int  # that shape it
    points: Array  # (n, 3)
    normals: Array  # (n, 3), unit


def swept_instead(pieces: Sequence[Explained], noise: float) -> tuple[Primitive, Array] | None:
    """One swept or analytic surface, and its covariance, that should stand for freeform ones; None to keep these.

    A swept surface must leave nothing but noise of the points, turn no farther from their normals and be no dearer
    than the surfaces so far by chi^2 + a price for each parameter; an analytic one goes first if no dearer.
    """
    judge = _Judge.of(pieces, noise)
    most = judge.most
    best: tuple[Primitive, Array] | None = None
    for fitted in (fit_extrusion, fit_revolution):
        found = fitted(judge.points, judge.normals, noise)
        if found is None:
            continue
        cost = judge.cost(found.surface.distance(judge.points), found.numbers)
        if cost <= most and judge.accepts(found.surface):
            most, best = cost, (found.surface, found.covariance)
    return None if best is None else _simpler(judge, most) or best


def _simpler(judge: _Judge, most: float) -> tuple[Primitive, Array] | None:
    """The cheapest analytic surface that costs no more than `most`, and its covariance."""
    best: Primitive | None = None
    for kind in ANALYTIC_KINDS:
        found = robust_fit(kind, judge.points, judge.normals, judge.noise)
        if found is None:
            continue
        cost = judge.cost(found[0].distance(judge.points), found[0].freedom)
        if cost <= most and judge.accepts(found[0]):
            most, best = cost, found[0]
    return None if best is None else (best, uncertainty(best, judge.points, judge.noise).covariance)


@dataclass(frozen=True)
class _Judge:
    """Says what surfaces cost over some points, and which explain them."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3)
    noise: float
    sigma: float
    pieces: NDArray[np.int64]  # (n,): the piece of the patch that each point is in
    most: float  # cost of the surfaces so far
    misfit: float  # of the pieces from these
    turn: float  # of the normals, at most

    @classmethod
    def of(cls, given: Sequence[Explained], noise: float) -> _Judge:
        """Who allows what the surfaces so far leave, and what noise does."""
        share = min(1.0, _MOST_POINTS / sum(len(piece.points) for piece in given))
        seen = [thinned(piece.points, piece.normals, max(int(share * len(piece.points)), 1)) for piece in given]
        points, normals = (np.vstack(columns) for columns in zip(*seen))
        residual = np.concatenate([piece.surface.distance(some) for piece, (some, _) in zip(given, seen)])
        turned = np.concatenate([piece.surface.angles(*some) for piece, some in zip(given, seen)])
        pieces = _pieces(points)
        sigma = float(np.clip(usual_size(residual), FINEST, _SLACK * max(noise, FINEST)))
        turn = float(np.clip(_TURNED * turned.mean(), *_TURN))
        judge = cls(points, normals, noise, sigma, pieces, 0.0, _misfit(residual, pieces, noise), turn)
        return replace(judge, most=judge.cost(residual, sum(piece.numbers for piece in given)))

    def cost(self, residual: Array, numbers: int) -> float:
        """chi^2 of distances (n,) and the price of the numbers behind them."""
        square = np.minimum((residual / self.sigma) ** 2, _OUTLIER)
        return float(square.sum() + _PRICE * numbers)

    def accepts(self, surface: Primitive) -> bool:
        """Whether the surface leaves nothing but noise, in no piece of the patch, and has the points' normals."""
        if not explains(surface, self.points, _SLACK * max(self.noise, FINEST)):
            return False
        fits = _misfit(surface.distance(self.points), self.pieces, self.noise) <= max(self.misfit, 1.0)
        return fits and float(surface.angles(self.points, self.normals).mean()) <= self.turn


def _pieces(points: Array) -> NDArray[np.int64]:
    """The piece (n,) of each point, when they are cut in halves across their longest side again and again."""
    pieces = np.zeros(len(points), np.int64)
    for _ in range(_HALVINGS):
        if len(points) < 2 * _PIECE * (pieces.max() + 1):
            break
        for number in range(int(pieces.max()) + 1):
            own = np.flatnonzero(pieces == number)
            side = points[own, int(np.ptp(points[own], axis=0).argmax())]
            pieces[own[side > np.median(side)]] += 2**20
        pieces = np.unique(pieces, return_inverse=True)[1].ravel()
    return pieces


def _misfit(residual: Array, pieces: NDArray[np.int64], noise: float) -> float:
    """chi^2 of the mean distances of the pieces, in units of what noise does not reach."""
    floor = max(noise, FINEST)
    residual = np.clip(residual, -4 * floor, 4 * floor)
    count = np.bincount(pieces)
    mean = np.bincount(pieces, residual) / count
    inner = float(np.mean((residual - mean[pieces]) ** 2)) / count
    systematic = max(FINEST, _SYSTEMATIC * noise) ** 2
    usual = float((inner / (inner + systematic)).sum())
    most = max(usual * (1 + _SURPRISE * np.sqrt(2 / len(count))), _FINE * len(count))
    return float((mean**2 / (inner + systematic)).sum()) / most
