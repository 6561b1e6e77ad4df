"""A folder of random parts as .brep files, each made in a process with a time limit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from OCP.BRepTools import BRepTools

from sed2cad.training.child import Run, in_children
from sed2cad.training.dataset import Progress
from sed2cad.training.synthetic.part import ATTEMPTS, try_part

PART_LIMIT = 60.0
"""Seconds for one sub-seed. Far above the seconds that sound parts take: only true hangs meet it, on any machine."""


@dataclass(frozen=True)
class SyntheticReport:
    """What became of each part."""

    parts: list[Path]  # written now or there before
    failed: dict[Path, str]  # file -> reason of the last attempt


def write_parts(
    folder: Path, count: int, seed: int = 0, workers: int = 1, progress: Progress | None = None
) -> SyntheticReport:
    """Write `folder`/synthetic_NUMBER.brep for the numbers seed .. seed + count - 1; files that are there are kept.

    A part depends on its number alone, so its bytes are the same in whatever run, order or process it is made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(number, folder / f"synthetic_{number:06d}.brep") for number in range(seed, seed + count)]
    parts, failed = [], {}
    for done, ((_, path), reason) in enumerate(in_children(_write, jobs, _made, workers, PART_LIMIT), 1):
        if reason:
            failed[path] = reason
        else:
            parts.append(path)
        if progress:
            progress(done, count, path.name)
    return SyntheticReport(sorted(parts), failed)


def _made(run: Run, job: tuple[int, Path]) -> str:
    """Make a part that is not there yet."""
    return "" if job[1].exists() else first_sound(run, *job)


def first_sound(run: Run, seed: int, path: Path) -> str:
    """Run the sub-seeds of a seed until one is sound; empty, or the reason why the last is not."""
    reason = ""
    for attempt in range(ATTEMPTS):
        reason = run(seed, attempt, path)
        if not reason:
            break
    return reason


def _write(seed: int, attempt: int, path: Path) -> None:
    """Write the part of one sub-seed; a killed process leaves no half-written file."""
    unfinished = path.with_suffix(".part")
    if not BRepTools.Write_s(try_part(seed, attempt).wrapped, str(unfinished)):
        raise OSError(f"cannot write {unfinished}")
    unfinished.rename(path)
