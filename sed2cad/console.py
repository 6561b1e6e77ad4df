"""What the commands say: progress on stderr, results on stdout."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sed2cad.model import CadModel

_EVERY = 50  # parts between two lines
_MOST_FACES = 12  # listed that are not exact


class Progress:
    """One line on stderr for each stage that has ended: what it found and how long it took."""

    def __init__(self, quiet: bool) -> None:
        self.quiet, self.start = quiet, time.perf_counter()
        self.last = self.start

    def __call__(self, stage: str, message: str) -> None:
        now = time.perf_counter()
        seconds, self.last = now - self.last, now
        if self.quiet:
            return
        if not sys.stderr.isatty():
            print(f"{stage:<10} {message}  {seconds:.1f} s", file=sys.stderr, flush=True)
            return
        from rich.console import Console
        from rich.text import Text

        line = Text.assemble((f"{stage:<10} ", "bold cyan"), message, (f"  {seconds:.1f} s", "dim"))
        Console(stderr=True).print(line)

    @property
    def total(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.start


def counter(stage: str, quiet: bool) -> Callable[[int, int, str], None]:
    """tell(done, total, name): a line on stderr now and then, and for the last."""

    def tell(done: int, total: int, name: str) -> None:
        if not quiet and (done % _EVERY == 0 or done == total):
            print(f"{stage:<10} {done} of {total}: {name}", file=sys.stderr, flush=True)

    return tell


def print_summary(model: CadModel, step: Path, seconds: float, verbose: bool) -> None:
    """What was made, on stdout; warnings go to stderr."""
    report, unit = model.report, model.unit
    state = "closed solid" if report.closed else "open shell"
    exact = "all exact" if report.exact_faces == report.faces else f"{report.exact_faces} exact"
    print(f"{step}: {state}, {report.faces} faces, {exact} ({report.rung})")
    whole = report.deviation
    if whole.rms == whole.rms:
        print(f"deviation from the scan: rms {whole.rms:.3g}, p95 {whole.p95:.3g}, max {whole.max:.3g} {unit}")
    volume = f"volume {report.volume:.6g} {unit}^3, " if report.closed else ""
    print(f"{volume}{seconds:.1f} s")
    for boundary in report.boundaries:
        print(f"  open {boundary}")
    if report.reason:
        print(f"warning: {report.reason}", file=sys.stderr)
    for warning in report.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    told = [face for face in report.face_list if verbose or face.rung != "exact"]
    for face in told if verbose else told[:_MOST_FACES]:
        off = f"rms {face.deviation:.3g} {unit}" if face.deviation == face.deviation else "no points"
        print(f"  {face.name:<16} {face.rung:<8} {off}")
    if len(told) > _MOST_FACES and not verbose:
        print(f"  and {len(told) - _MOST_FACES:,} more like these (--verbose lists all)")
    for constraint in report.constraints if verbose else ():
        print(f"  {constraint}")
