"""A folder of CAD files to a packed training set: one small .npz per part, and a report; no pickle."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sed2cad.errors import UsageError
from sed2cad.files import require_folder
from sed2cad.network.types import PATCH_TYPES
from sed2cad.training.cad import label_part
from sed2cad.training.child import Run, in_children
from sed2cad.training.labelled_part import LabelledPart

SUFFIXES = {".step", ".stp", ".brep"}

REPORT = "report.json"

Progress = Callable[[int, int, str], None]
"""Called as progress(done, total, file name)."""


@dataclass(frozen=True)
class DatasetReport:
    """What became of each file."""

    packed: list[Path]
    skipped: dict[Path, str]  # file -> reason
    faces: dict[str, int]  # type -> how many, over all parts
    disguised: dict[str, int]  # of those: held by the file as freeform surfaces
    minutes: float  # of the clock
    megabytes: float

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        skipped = {str(file): reason for file, reason in self.skipped.items()}
        rows = {"files": len(self.packed), "skipped": skipped, "faces": self.faces, "disguised": self.disguised}
        numbers = {"minutes": round(self.minutes, 2), "megabytes": round(self.megabytes, 2)}
        path.write_text(json.dumps({**rows, **numbers}, indent=1) + "\n")

    def __str__(self) -> str:
        kinds = ", ".join(f"{count} {name}" for name, count in self.faces.items() if count)
        return (
            f"{len(self.packed)} parts, {self.megabytes:.1f} MB, {self.minutes:.1f} minutes; faces: {kinds}; "
            f"{sum(self.disguised.values())} analytic faces found disguised as freeform; "
            f"{len(self.skipped)} files skipped"
        )


def build_dataset(folder: Path, out: Path, workers: int = 1, progress: Progress | None = None) -> DatasetReport:
    """Pack every CAD file below `folder` as `out`/NAME.npz (those there already are kept) and write report.json."""
    start = time.monotonic()
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    out.mkdir(parents=True, exist_ok=True)
    names = {path: "_".join(path.relative_to(folder).with_suffix("").parts) + ".npz" for path in files}
    packed, skipped = [], {}
    runs = in_children(_pack, files, lambda run, file: _once(run, file, out / names[file]), workers)
    for done, (path, reason) in enumerate(runs, 1):
        if reason:
            skipped[path] = reason
        else:
            packed.append(out / names[path])
        if progress:
            progress(done, len(files), path.name)
    report = _report(sorted(packed), skipped, (time.monotonic() - start) / 60)
    report.save(out / REPORT)
    return report


def _report(packed: list[Path], skipped: dict[Path, str], minutes: float) -> DatasetReport:
    """Count the faces of the packed parts."""
    counts = np.zeros((2, len(PATCH_TYPES)), int)
    for path in packed:
        part = load_part(path)
        counts += [np.bincount(types, minlength=len(PATCH_TYPES)) for types in (part.type, part.type[part.disguised])]
    faces, disguised = (dict(zip(PATCH_TYPES, row.tolist())) for row in counts)
    return DatasetReport(packed, skipped, faces, disguised, minutes, sum(path.stat().st_size for path in packed) / 1e6)


def packed_parts(folder: Path) -> list[Path]:
    """The packed parts in a folder, in a fixed order."""
    return sorted(folder.glob("*.npz"))


def parts_in(folder: Path, cad: bool = False) -> list[Path]:
    """The packed parts in a folder; with `cad` its CAD files, where none is packed. UsageError where there is none."""
    require_folder(folder)
    found = packed_parts(folder)
    if cad and not found:
        found = sorted(file for file in folder.glob("*") if file.suffix.lower() in SUFFIXES)
    if not found:
        raise UsageError(f"{folder}: there are no packed parts in it; make them with `sed2cad dataset`")
    return found


def load_part(path: Path) -> LabelledPart:
    """Read one packed part, or label that of a CAD file."""
    return LabelledPart.load(path) if path.suffix == ".npz" else label_part(path)


def _once(run: Run, path: Path, out: Path) -> str:
    """Pack a part that is not there yet."""
    return "" if out.exists() else run(path, out)


def _pack(path: Path, out: Path) -> None:
    half = out.with_suffix(".part")
    label_part(path).save(half)
    half.rename(out)  # a killed child leaves no half-written part
