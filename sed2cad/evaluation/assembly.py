"""CAD files scanned, reconstructed and scored against themselves, each part in processes of its own."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sed2cad.brep.worker import Failure, run_alone
from sed2cad.errors import UsageError
from sed2cad.evaluation.made_scans import CLEAN, KINDS, TABLE, MadeScan, make_scan, patches_of
from sed2cad.evaluation.scores import NAN, peak_memory
from sed2cad.evaluation.solid_scores import ScoreJob, SolidScore, score_solid
from sed2cad.files import require_folder
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.segment import Segmentation
from sed2cad.settings import Settings
from sed2cad.training.dataset import SUFFIXES

TRUE, NETWORK = LABELS = ("true", "network")
OTHER_SECONDS = 180.0
"""For making a scan and for scoring a solid."""


@dataclass(frozen=True)
class AssemblySettings:
    """What is scored; UsageError for unknown words."""

    labels: str  # where the patches come from
    kind: str = CLEAN  # of the scans
    limit: int | None = None  # so many parts, spread evenly over the sorted names
    workers: int = 1  # parts at a time
    timeout: float = 180.0  # seconds for each reconstruction

    def __post_init__(self) -> None:
        for word, known in ((self.labels, LABELS), (self.kind, KINDS)):
            if word not in known:
                raise UsageError(f"unknown word {word!r}: it must be one of {', '.join(known)}")


@dataclass(frozen=True)
class PartRow:
    """What became of one part."""

    part: str
    failure: str = ""  # what kept it from being scored
    detail: str = ""  # one clause about the failure
    seconds: float = NAN  # from the scan in memory to the STEP file; the time limit where that was reached
    peak_mb: float = NAN  # of the reconstruction's process
    rung: str = ""  # of the ladder
    score: SolidScore | None = None

    @property
    def closed(self) -> bool:
        return self.score is not None and self.score.closed

    @property
    def solved(self) -> bool:
        return self.score is not None and self.score.solved

    @property
    def exact(self) -> bool:
        return self.score is not None and self.score.exact

    @property
    def causes(self) -> tuple[str, ...]:
        """Why it is not exact; a part that is not solved does not list the types of its faces."""
        if self.score is None:
            return (self.failure,)
        return self.score.faults or self.score.differences


Progress = Callable[[int, int, PartRow], None]
"""Called as progress(done, total, row) when a part is done."""


def evaluate_assembly(folder: Path, settings: AssemblySettings, progress: Progress | None = None) -> list[PartRow]:
    """A row for each CAD file below a folder. UsageError where there is none."""
    files = cad_files(folder, settings.limit)
    pool = ThreadPoolExecutor(settings.workers)  # its threads wait for the processes
    try:
        runs = [pool.submit(partial(score_part, file, _name(file, folder), settings)) for file in files]
        for done, run in enumerate(as_completed(runs), 1):
            if progress:
                progress(done, len(files), run.result())
        return [run.result() for run in runs]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # Ctrl-C: begin no further part


def cad_files(folder: Path, limit: int | None) -> list[Path]:
    """The CAD files below a folder in order, or `limit` of them, evenly spread."""
    require_folder(folder)
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    if not files:
        raise UsageError(f"{folder}: there is no .step, .stp or .brep file in it; choose another folder")
    if limit is None or limit >= len(files):
        return files
    return [files[index] for index in np.linspace(0, len(files) - 1, limit).astype(np.int64)]


def _name(file: Path, folder: Path) -> str:
    return "_".join(file.relative_to(folder).with_suffix("").parts)


def score_part(file: Path, name: str, settings: AssemblySettings) -> PartRow:
    """Scan, reconstruct and score, one process after another."""
    made = run_alone(_make, (file, settings.kind), OTHER_SECONDS)
    if isinstance(made, Failure):
        return PartRow(name, "no scan of the true part", made.sentence)
    with tempfile.TemporaryDirectory(prefix="sed2cad-") as folder:
        step = Path(folder) / "part.step"
        job = Job(made, settings.labels, step, cap=settings.kind == TABLE)
        found = run_alone(reconstruct_part, job, settings.timeout)
        if isinstance(found, Failure):
            failure = {"crash": "crashed", "timeout": "timeout", "error": "ended with an error"}[found.kind]
            return PartRow(name, failure, found.sentence, settings.timeout if found.kind == "timeout" else NAN)
        score = scored(step, file)
    row = partial(PartRow, name, seconds=found.seconds, peak_mb=found.peak_mb, rung=found.rung)
    if isinstance(score, Failure):
        return row(failure="could not be scored", detail=score.sentence)
    return row(score=score, detail=score.error)


def scored(written: Path, truth: Path) -> SolidScore | Failure:
    """The score; without merging faces where the kernel does not survive that."""
    score = run_alone(score_solid, ScoreJob(written, truth), OTHER_SECONDS)
    if isinstance(score, Failure) and score.kind != "error":
        return run_alone(score_solid, ScoreJob(written, truth, merge=False), OTHER_SECONDS)
    return score


@dataclass(frozen=True)
class Job:
    """A reconstruction."""

    made: MadeScan
    labels: str
    step: Path  # to be written
    cap: bool  # close what the scan does not show


@dataclass(frozen=True)
class Reconstructed:
    """What is known of a reconstruction beside its STEP file."""

    seconds: float
    peak_mb: float
    rung: str


def reconstruct_part(job: Job) -> Reconstructed:
    """The pipeline on a scan, with the network's patches or the true ones, up to the STEP file."""
    from sed2cad.pipeline import Clock, by_network, reconstruct_from

    def by_truth(scan: Scan, settings: Settings, clock: Clock) -> Segmentation:
        patches = patches_of(job.made, scan)
        clock.done("segment", f"{len(patches)} true patches")
        return Segmentation(patches, scan)

    start = time.perf_counter()
    model = reconstruct_from(by_truth if job.labels == TRUE else by_network, job.made.raw, Settings(cap=job.cap))
    model.export_step(job.step)
    return Reconstructed(time.perf_counter() - start, peak_memory(), model.report.rung)


def _make(job: tuple[Path, str]) -> MadeScan:
    return make_scan(*job)
