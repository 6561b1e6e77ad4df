"""Score methods of segmentation on a folder of labelled parts, with one process or several."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from sed2cad.errors import ScanError, UsageError
from sed2cad.evaluation.methods import METHODS, NEED_NETWORK, NETWORK, Labelling, run_method
from sed2cad.evaluation.metrics import OF_POINTS
from sed2cad.evaluation.scores import MethodScores, PartScores, Seconds, score, summarise
from sed2cad.evaluation.trial import cloud_of, make_trial
from sed2cad.network.labeller import Labeller
from sed2cad.network.predict import predict
from sed2cad.network.types import without_torus
from sed2cad.training.dataset import parts_in
from sed2cad.training.samples import EDGE_DISTANCE

Progress = Callable[[int, int, str, float], None]
"""Called as progress(done, total, part, seconds) when a part is done."""


@dataclass(frozen=True)
class SegmentationSettings:
    """What is scored; UsageError for an unknown method."""

    methods: tuple[str, ...] = METHODS
    points: int | None = OF_POINTS  # of each part; None: as many as the network sees
    noise: float = 0.0  # displacement along the normal in radii of the part; the paper's is 0.04
    limit: int | None = None  # only the first parts
    weights: Path | None = None  # None: those shipped
    workers: int = 1  # processes of one thread
    seed: int = 0

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in METHODS:
                raise UsageError(f"unknown method {method!r}: it must be one of {', '.join(METHODS)}")


@dataclass(frozen=True)
class SegmentationResult:
    """All rows: methods in the order asked for, and each part with each method, by part."""

    settings: SegmentationSettings
    methods: tuple[MethodScores, ...]
    parts: tuple[PartScores, ...]


def evaluate_segmentation(
    data: Path | Sequence[Path],
    settings: SegmentationSettings,
    network: Labeller | None = None,
    progress: Progress | None = None,
) -> SegmentationResult:
    """Score each method on packed parts (a folder or files).

    `network` takes the place of `settings.weights`, in this process. UsageError for a folder without parts,
    WeightsError. A method that fails on a part labels none of its points, and the row says why.
    """
    files = (parts_in(data) if isinstance(data, Path) else list(data))[: settings.limit]
    given = network is not None
    if not given and set(settings.methods) & set(NEED_NETWORK):
        network = Labeller.load(settings.weights)
    rows: list[PartScores] = []
    for done, (name, seconds, scores) in enumerate(_runs(files, settings, network, given), 1):
        rows += scores
        if progress:
            progress(done, len(files), name, seconds)
    place = {path.stem: index for index, path in enumerate(files)}
    rows.sort(key=lambda row: place[row.part])
    summaries = (summarise([row for row in rows if row.method == method]) for method in settings.methods)
    return SegmentationResult(settings, tuple(summaries), tuple(rows))


def score_network(files: Sequence[Path], network: Labeller, noise: float = 0.0) -> MethodScores:
    """The network alone on packed parts."""
    settings = SegmentationSettings((NETWORK,), None, noise)
    return evaluate_segmentation(files, settings, network).methods[0]


def score_part(path: Path, settings: SegmentationSettings, network: Labeller | None) -> list[PartScores]:
    """Every method on one part; the scan and the network's labels are made once.

    Where the network's classes know no torus, torus and B-spline are one type for every method.
    """
    cloud, paper = cloud_of(path, settings.points, settings.seed), network is not None and not network.shape.torus
    cloud = replace(cloud, type=without_torus(cloud.type)) if paper else cloud
    name, nothing, labels = path.stem, Labelling.nothing(len(cloud.points)), None
    try:
        trial = make_trial(cloud, settings.noise, settings.seed, name)
    except ScanError as problem:
        return [score(name, method, cloud, nothing, Seconds(), str(problem)) for method in settings.methods]
    start = time.perf_counter()
    if network is not None:
        labels = predict(trial.scan.points, trial.scan.normals, network, settings.seed)
    predicted, rows = time.perf_counter() - start, []
    for method in settings.methods:
        found, error = nothing, ""
        try:
            found = run_method(method, trial.scan, labels, EDGE_DISTANCE / trial.scan.frame.scale, settings.seed)
            found = trial.to_cloud(found)
            if paper and found.type is not None:
                found = replace(found, type=without_torus(found.type))
        except Exception as problem:  # one part must not end the table: its row says what happened
            error = f"{type(problem).__name__}: {problem}"
        seconds = Seconds(trial.seconds, predicted if method in NEED_NETWORK else 0.0, found.seconds)
        rows.append(score(name, method, cloud, found, seconds, error))
    return rows


def _runs(
    files: Sequence[Path], settings: SegmentationSettings, network: Labeller | None, given: bool
) -> Iterator[tuple[str, float, list[PartScores]]]:
    """Part, seconds and rows, as the parts are done."""
    if given or settings.workers == 1:
        for path in files:
            yield _timed(path, settings, network)
        return
    with ProcessPoolExecutor(
        settings.workers,
        multiprocessing.get_context("spawn"),
        _start_worker,
        (settings, network is not None),
    ) as pool:
        for run in as_completed([pool.submit(_in_worker, path) for path in files]):
            yield run.result()


def _timed(path: Path, settings: SegmentationSettings, network: Labeller | None) -> tuple[str, float, list[PartScores]]:
    start = time.perf_counter()
    rows = score_part(path, settings, network)
    return path.stem, time.perf_counter() - start, rows


_worker: tuple[SegmentationSettings, Labeller | None]
"""Of a worker process: set once at its start, since weights are slow to send along."""


def _start_worker(settings: SegmentationSettings, with_network: bool) -> None:
    global _worker
    _worker = settings, Labeller.load(settings.weights) if with_network else None


def _in_worker(path: Path) -> tuple[str, float, list[PartScores]]:
    return _timed(path, *_worker)
