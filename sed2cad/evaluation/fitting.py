"""Fits of known surfaces against the Cramer-Rao bound, the choice of the kind, and the time of a part."""

from __future__ import annotations

import itertools
import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from sed2cad.evaluation.bound import chart_coordinates, cramer_rao
from sed2cad.evaluation.choice import STRENGTHS, ChoiceScores, choose, ladder
from sed2cad.evaluation.relations import RelationCounts, evaluate_relations
from sed2cad.evaluation.spline_patches import SplinePatchScores, score_spline_patches
from sed2cad.evaluation.true_patches import FREEFORM, TruePatch, true_patch
from sed2cad.fitting import fit, fit_patches
from sed2cad.primitives.base import Array, Patch, Primitive
from sed2cad.primitives.refine import centred, refine
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.scan.scan import Frame, Scan
from sed2cad.training.dataset import parts_in

NOISES = (0.0002, 0.001, 0.005)  # of the size
COUNTS = (100, 500, 5000)
COVERAGES = (360.0, 180.0, 90.0, 45.0)  # degrees
OUTLIERS = (0.0, 0.1, 0.2)
_FACES = {"plane": 23, "cylinder": 10, "cone": 2, "sphere": 1, "torus": 2, "wave": 1, "lobes": 1}  # of a part: 40
_FACE_POINTS = 500

Progress = Callable[[int, int, float], None]
"""Called as progress(done, total, seconds) when a cell is done."""
Fitter = Callable[[str, Array, Array, float], tuple[Primitive, float, Array] | None]


@dataclass(frozen=True)
class FittingSettings:
    """How much is run; the cells are all combinations of the constants above."""

    seeds: int = 50  # of each cell of an analytic primitive
    workers: int = 2  # processes of one thread
    noises: tuple[float, ...] = NOISES
    counts: tuple[int, ...] = COUNTS
    coverages: tuple[float, ...] = COVERAGES
    outliers: tuple[float, ...] = OUTLIERS
    strengths: tuple[float, ...] = STRENGTHS  # sigma, of the ladder towards what cannot be told apart

    @property
    def few_seeds(self) -> int:
        """Of the choice of kinds and of B-splines, which take longer."""
        return max(self.seeds // 5, 1)


@dataclass(frozen=True)
class Cell:
    """One combination."""

    shape: str
    noise: float
    count: int
    coverage: float
    outliers: float

    def patches(self, seeds: int) -> Iterator[TruePatch]:
        """The same for every run."""
        key = [ord(self.shape[0]), ord(self.shape[1]), round(1e6 * self.noise), self.count, round(self.coverage)]
        for seed in range(seeds):
            rng = np.random.default_rng([*key, round(100 * self.outliers), seed])
            yield true_patch(self.shape, self.count, self.coverage, self.noise, self.outliers, rng)


@dataclass(frozen=True)
class CellScores:
    """The fits of one cell. Ratios are root mean squares of errors over the bound, one for each chart parameter."""

    cell: Cell
    ratios: tuple[float, ...]  # of the fit; infinite where one found nothing
    attainable: tuple[float, ...]  # of least squares from the truth on the inliers: what no estimator beats by much
    honesty: float  # median of error^T C^-1 error over that of chi^2, C the covariance that the fit claims
    inside: float  # share of the errors within the 95 % ellipsoid of C
    seconds: float  # of a fit


@dataclass(frozen=True)
class SplineScores:
    """B-splines of one cell."""

    cell: Cell
    residual: float  # rms distance of the true surface from the fit in units of the noise, over all seeds
    worst: float  # of a seed
    seconds: float  # of a fit


@dataclass(frozen=True)
class FittingResult:
    """All rows, in the order of the cells."""

    settings: FittingSettings
    cells: tuple[CellScores, ...]
    choices: tuple[ChoiceScores, ...]
    ladder: tuple[ChoiceScores, ...]  # near the limit of what can be told apart
    splines: tuple[SplineScores, ...]
    part_seconds: float  # to fit the patches of a part of 40 faces
    spline_patches: tuple[SplinePatchScores, ...]  # of real parts, where some were given
    relations: tuple[RelationCounts, ...]  # of their faces
    seconds: float


def evaluate_fitting(
    settings: FittingSettings, parts: Path | None = None, progress: Progress | None = None
) -> FittingResult:
    """Fit every cell, with several processes; then the time of a part is taken, then a folder of parts is looked at.

    UsageError for a folder without parts.
    """
    start = time.perf_counter()
    files = [] if parts is None else parts_in(parts, cad=True)
    jobs: list[tuple[Cell, int]] = [(cell, settings.seeds) for cell in _cells(settings, ANALYTIC_KINDS)]
    jobs += [(cell, settings.few_seeds) for cell in _cells(settings, FREEFORM)]
    found: list[tuple[CellScores | SplineScores, ChoiceScores | None] | None] = [None] * len(jobs)
    for done, (index, scores) in enumerate(_runs(jobs, settings), 1):
        found[index] = scores
        if progress:
            progress(done, len(jobs), time.perf_counter() - start)
    rows = [pair for pair in found if pair is not None]
    near = tuple(ladder(settings.few_seeds, settings.counts, settings.strengths))
    part_seconds = seconds_of_a_part()
    return FittingResult(
        settings,
        tuple(scores for scores, _ in rows if isinstance(scores, CellScores)),
        tuple(choice for _, choice in rows if choice is not None),
        near,
        tuple(scores for scores, _ in rows if isinstance(scores, SplineScores)),
        part_seconds,
        score_spline_patches(files, workers=settings.workers),
        tuple(evaluate_relations(files, settings.workers)),
        time.perf_counter() - start,
    )


def score_cell(cell: Cell, seeds: int, fitter: Fitter = fit) -> CellScores:
    """An analytic primitive, fitted as often as there are seeds."""
    ratios, attainable, claims, seconds = [], [], [], 0.0
    for patch in cell.patches(seeds):
        assert patch.primitive is not None
        truth = centred(patch.primitive, patch.feet)
        limit = np.sqrt(np.diag(cramer_rao(truth, patch.feet[patch.inlier], cell.noise)))
        start = time.perf_counter()
        found = fitter(cell.shape, patch.points, patch.normals, cell.noise)
        seconds += time.perf_counter() - start
        best = refine(truth, patch.points[patch.inlier], cell.noise, steps=30, robust=False)
        attainable.append(chart_coordinates(truth, best) / limit)
        if found is None:
            ratios.append(np.full(len(limit), np.inf))
            claims.append(np.inf)
            continue
        ratios.append(chart_coordinates(truth, found[0]) / limit)
        error = chart_coordinates(found[0], truth)
        claims.append(float(error @ np.linalg.pinv(found[2], rcond=1e-14, hermitian=True) @ error))
    freedom = len(limit)
    return CellScores(
        cell,
        _root_mean_squares(ratios),
        _root_mean_squares(attainable),
        float(np.median(claims) / chi2.median(freedom)),
        float(np.mean(np.array(claims) < chi2.ppf(0.95, freedom))),
        seconds / seeds,
    )


def score_splines(cell: Cell, seeds: int) -> SplineScores:
    """A freeform surface, fitted as often as there are seeds."""
    squares, seconds = [], 0.0
    for patch in cell.patches(seeds):
        start = time.perf_counter()
        found = fit("bspline", patch.points, patch.normals, cell.noise)
        seconds += time.perf_counter() - start
        gaps = found[0].distance(patch.feet) if found else np.array([np.inf])
        squares.append(float(np.mean(gaps**2)) / cell.noise**2)
    return SplineScores(cell, float(np.sqrt(np.mean(squares))), float(np.sqrt(max(squares))), seconds / seeds)


def seconds_of_a_part() -> float:
    """To fit the 40 patches of a part, with 500 points each and the noise of a good scan; the best of three."""
    rng = np.random.default_rng(40)
    coverages = itertools.cycle((360.0, 180.0, 90.0))
    kinds = [kind for kind, count in _FACES.items() for _ in range(count)]
    faces = [true_patch(kind, _FACE_POINTS, next(coverages), 0.001, 0.02, rng) for kind in kinds]
    points, normals = (np.vstack([getattr(face, name) for face in faces]) for name in ("points", "normals"))
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), noise=0.001, spacing=0.01)
    everything = np.ones(_FACE_POINTS, bool)
    patches = [
        Patch(np.arange(k * _FACE_POINTS, (k + 1) * _FACE_POINTS), kind, everything)
        for k, kind in enumerate("bspline" if kind in FREEFORM else kind for kind in kinds)
    ]
    times = []
    for _ in range(3):
        start = time.perf_counter()
        fit_patches(scan, patches)
        times.append(time.perf_counter() - start)
    return min(times)


def _cells(settings: FittingSettings, shapes: tuple[str, ...]) -> list[Cell]:
    """A freeform shape is always whole, with no outliers or the most."""
    if shapes == FREEFORM:
        outliers = tuple(dict.fromkeys((min(settings.outliers), max(settings.outliers))))
        combinations = itertools.product(shapes, settings.noises, settings.counts, (360.0,), outliers)
    else:
        combinations = itertools.product(
            shapes, settings.noises, settings.counts, settings.coverages, settings.outliers
        )
    return [Cell(*values) for values in combinations]


def _root_mean_squares(ratios: list[Array]) -> tuple[float, ...]:
    return tuple(map(float, np.sqrt(np.mean(np.square(ratios), axis=0))))


_Scores = tuple[int, tuple[CellScores | SplineScores, ChoiceScores | None]]


def _runs(jobs: list[tuple[Cell, int]], settings: FittingSettings) -> Iterator[_Scores]:
    """Index and scores of each cell, as they are done; the choice of the kind only without outliers."""
    work = [(index, cell, seeds, settings.few_seeds) for index, (cell, seeds) in enumerate(jobs)]
    if settings.workers == 1:
        yield from map(_score, work)
        return
    with ProcessPoolExecutor(settings.workers, multiprocessing.get_context("spawn")) as pool:
        for run in as_completed([pool.submit(_score, job) for job in reversed(work)]):
            yield run.result()


def _score(job: tuple[int, Cell, int, int]) -> _Scores:
    index, cell, seeds, few = job
    if cell.shape in FREEFORM:
        return index, (score_splines(cell, seeds), None)
    choice = None
    if cell.outliers == 0:
        choice = choose(cell.shape, f"{cell.count} points", cell.noise, list(cell.patches(few)))
    return index, (score_cell(cell, seeds), choice)
