"""The paper's Table 4: the network trained without each of its ideas, all under the same short conditions.

The row without fitting to non-edge points alone is not here: it concerns the fits, not the network.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from sed2cad.errors import UsageError
from sed2cad.evaluation.methods import NETWORK
from sed2cad.evaluation.segmentation import SegmentationSettings, evaluate_segmentation
from sed2cad.evaluation.tables import aligned, share, to_json
from sed2cad.files import write_text
from sed2cad.network.architecture import Architecture
from sed2cad.network.labeller import Labeller
from sed2cad.training.dataset import parts_in
from sed2cad.training.settings import TrainSettings
from sed2cad.training.train import train

Progress = Callable[[str], None]
"""Called with a sentence when a run has begun or ended."""
WHOLE = "full"
"""Name of the row that leaves nothing out."""


@dataclass(frozen=True)
class AblationSettings:
    """The same for every row of the table."""

    steps: int = 450
    seeds: int = 1
    points: int = 3_000  # of each cloud, trained on and scored
    rows: int = 1_024  # points a cloud in the loss
    batch: int = 4  # clouds a step
    parts: int = 400  # trained on
    validation_parts: int = 24  # scored
    pretrain_steps: int = 500
    threads: int = 1
    architecture: Architecture = field(default_factory=Architecture)


@dataclass(frozen=True)
class AblationRun:
    """One row trained once from one seed, and its scores on the validation parts (see MethodScores)."""

    row: str
    seed: int
    steps: int
    minutes: float  # of the processor, for the training
    p_miou: float
    p_miou_strict: float
    t_miou: float
    type_accuracy: float
    edge_f1: float


SCORES = ("p_miou", "p_miou_strict", "t_miou", "type_accuracy", "edge_f1")
HEADER = ("row", "seeds", "steps", "P-mIoU", "strict", "T-mIoU", "type acc", "edge F1", "train CPU min")


def rows_of(settings: AblationSettings) -> dict[str, TrainSettings]:
    """Name of each row of the table -> how it is trained; parts, points, order and motions are the same."""
    shape = settings.architecture
    whole = TrainSettings(
        architecture=shape,
        minutes=1e6,
        threads=settings.threads,
        batch=settings.batch,
        rows=settings.rows,
        warm_up=max(1, min(TrainSettings.warm_up, settings.steps // 10)),
        pretrain_steps=settings.pretrain_steps,
        pair_network=False,
        points=settings.points,
        parts=settings.parts,
        log_steps=max(1, min(TrainSettings.log_steps, settings.steps)),
        validate_minutes=1e6,
        held_out=1,
        validation_parts=1,
        max_steps=settings.steps,
    )
    return {
        WHOLE: whole,
        "without two branches": replace(whole, architecture=replace(shape, two_branches=False)),
        "without late fusion": replace(whole, architecture=replace(shape, late_fusion=False)),
        "without early fusion": replace(whole, architecture=replace(shape, early_fusion=False)),
        "without lambda": replace(whole, edge_weight=1.0),
        "plain input": replace(whole, architecture=replace(shape, local_width=0)),
    }


def run_ablation(
    data: Path, validation: Path, out: Path, settings: AblationSettings, progress: Progress | None = None
) -> list[AblationRun]:
    """Train and score each row from each seed; runs that have ended in `out` are read, not trained again.

    UsageError for folders without parts, or where `out` holds an ablation with other settings; more seeds may
    be added to it.
    """
    tell = progress or (lambda sentence: None)
    parts_in(data), parts_in(validation)
    _claim(out, settings)
    runs = []
    for seed in range(settings.seeds):  # all rows once, before any a second time
        for row, training in rows_of(settings).items():
            folder = out / f"{row.replace(' ', '_')}_{seed}"
            result = folder / "scores.json"
            if not result.exists():
                tell(f"{row}, seed {seed}: {settings.steps} steps")
                run = _run(row, replace(training, seed=seed), data, validation, folder, settings)
                write_text(result, to_json(asdict(run)))
                tell(f"{row}, seed {seed}: {run.minutes:.1f} CPU minutes, strict {run.p_miou_strict:.3f}")
            runs.append(AblationRun(**json.loads(result.read_text())))
    return runs


def ablation_text(runs: Sequence[AblationRun]) -> str:
    """A line for each row: means over seeds, and with several seeds their standard deviation."""
    return "\n".join(aligned([HEADER, *(_line(row, own) for row, own in _by_row(runs).items())]))


def ablation_json(settings: AblationSettings, runs: Sequence[AblationRun]) -> str:
    """Settings, means of each row, and all runs."""
    means = [
        {"row": row, **{name: np.mean([getattr(run, name) for run in own]).item() for name in SCORES}}
        for row, own in _by_row(runs).items()
    ]
    return to_json({"settings": asdict(settings), "rows": means, "runs": [asdict(run) for run in runs]})


def _run(
    row: str, training: TrainSettings, data: Path, validation: Path, folder: Path, settings: AblationSettings
) -> AblationRun:
    start = time.process_time()
    train(training, data, folder)
    minutes = (time.process_time() - start) / 60
    network = Labeller.load(folder / "last.safetensors")
    scored = SegmentationSettings((NETWORK,), settings.points, limit=settings.validation_parts)
    scores = evaluate_segmentation(validation, scored, network).methods[0]
    values = {name: getattr(scores, name) for name in SCORES}
    return AblationRun(row, training.seed, settings.steps, minutes, **values)


def _claim(out: Path, settings: AblationSettings) -> None:
    """Write the settings to `out`, or make sure that they are those of the runs there."""
    file = out / "settings.json"
    wanted = to_json(asdict(replace(settings, seeds=1, threads=1)))
    if file.exists() and file.read_text() != wanted:
        raise UsageError(f"{out}: holds an ablation with other settings; choose another folder")
    out.mkdir(parents=True, exist_ok=True)
    write_text(file, wanted)


def _by_row(runs: Sequence[AblationRun]) -> dict[str, list[AblationRun]]:
    """Runs of each row, rows in the order of their first run."""
    return {name: [run for run in runs if run.row == name] for name in dict.fromkeys(run.row for run in runs)}


def _line(row: str, runs: Sequence[AblationRun]) -> tuple[str, ...]:
    cells = []
    for name in SCORES:
        values = np.array([getattr(run, name) for run in runs], float)
        cells.append(share(float(values.mean())) + (f" ±{values.std(ddof=1):.3f}" if len(runs) > 1 else ""))
    minutes = np.mean([run.minutes for run in runs])
    return row, str(len(runs)), str(runs[0].steps), *cells, f"{minutes:.1f}"
