"""A folder of CAD files to a packed training set: one .npz of a labelled cloud per part, no pickle."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sed2cad.training.child import Child
from sed2cad.training.labelled_part import LabelledCloud, label_part

SUFFIXES = {".step", ".stp", ".brep"}

Progress = Callable[[int, int, str], None]
"""Called as progress(done, total, file name)."""


@dataclass(frozen=True)
class DatasetReport:
    """What became of each file."""

    packed: list[Path]
    skipped: dict[Path, str]  # file -> reason


def build_dataset(
    folder: Path, out: Path, workers: int = 1, progress: Progress | None = None, count: int = 10_000
) -> DatasetReport:
    """Label every CAD file below `folder` and write `out`/NAME.npz; parts that are there already are kept."""
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    out.mkdir(parents=True, exist_ok=True)
    names = {path: "_".join(path.relative_to(folder).with_suffix("").parts) + ".npz" for path in files}
    packed, skipped, done = [], {}, 0
    with ThreadPoolExecutor(workers) as pool:
        shares = [[(path, out / names[path], count) for path in files[i::workers]] for i in range(workers)]
        queue: multiprocessing.Queue[Any] = multiprocessing.Queue()
        runs = [pool.submit(_run, share, lambda *result: queue.put(result)) for share in shares]
        for done in range(1, len(files) + 1):
            path, reason = queue.get()
            if reason:
                skipped[path] = reason
            else:
                packed.append(out / names[path])
            if progress:
                progress(done, len(files), path.name)
        for run in runs:
            run.result()
    return DatasetReport(sorted(packed), skipped)


def packed_clouds(folder: Path) -> list[Path]:
    """The packed parts below a folder, in a fixed order."""
    return sorted(folder.glob("*.npz"))


def load_cloud(path: Path) -> LabelledCloud:
    """Read one packed part."""
    return LabelledCloud.load(path)


def _run(jobs: Iterable[tuple[Path, Path, int]], tell: Callable[[Path, str], None]) -> None:
    """Label each part in a child that is replaced when it crashes or takes too long."""
    child = Child(_pack)
    for path, out, count in jobs:
        if out.exists():
            tell(path, "")
            continue
        tell(path, child.run(path, out, count))
    child.close()


def _pack(path: Path, out: Path, count: int) -> None:
    part = out.with_suffix(".part")
    label_part(path, count).save(part)
    part.rename(out)  # a killed child leaves no half-written cloud
