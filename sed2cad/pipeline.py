"""The whole reconstruction, read top to bottom."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sed2cad.absorbing import absorbed
from sed2cad.assembly import Assembler, Assembly
from sed2cad.brep.worker import warm_up
from sed2cad.completion.complete import Completed, complete
from sed2cad.fitting import fit_patches
from sed2cad.joining import joined
from sed2cad.model import CadModel
from sed2cad.network.labeller import Labeller
from sed2cad.network.predict import predict
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.report.summary import summarise
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.read import read_scan
from sed2cad.scan.scan import Scan
from sed2cad.segmentation.segment import UNEVEN, Segmentation, segment
from sed2cad.settings import Settings

_FARTHEST = 3.0  # deviations of a point that still belongs to a face
PLURALS = {"torus": "tori"}
Progress = Callable[[str, str], None]
"""Called as progress(stage, message) when a stage has ended."""
Segmenter = Callable[[Scan, Settings, "Clock"], Segmentation]
"""What finds the patches of a prepared scan, and perhaps more noise in it, and tells the clock of its stages."""


def reconstruct(
    scan: str | Path | RawScan, settings: Settings | None = None, progress: Progress | None = None
) -> CadModel:
    """A scan, a file or points in memory, becomes a solid of exact faces.

    ScanError for a scan that cannot be used, WeightsError for the network, AssemblyError when not even a faceted
    solid could be built. The same scan and seed give the same solid.
    """
    return reconstruct_from(by_network, scan, settings or Settings(), progress)


def reconstruct_from(
    segmenter: Segmenter, scan: str | Path | RawScan, settings: Settings, progress: Progress | None = None
) -> CadModel:
    """`reconstruct` with any source of patches."""
    clock = Clock(progress or (lambda stage, message: None))
    warm_up()  # the CAD kernel loads in a process of its own meanwhile
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        raw = read_scan(Path(scan)) if isinstance(scan, (str, Path)) else scan
        prepared = _tolerant(prepare(raw, settings.seed), settings)
        clock.done("scan", f"{len(prepared.points):,} points, noise {prepared.noise * prepared.frame.scale:.2g}")
        completed, assembly = _solid(segmenter(prepared, settings, clock), settings, clock)
    notes = tuple(dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, UserWarning)))
    return CadModel(
        name=raw.name,
        unit=settings.unit,
        frame=prepared.frame,
        fitted=assembly.fitted,
        topology=assembly.topology,
        brep=assembly.solid.brep,
        face_names=assembly.face_names,
        report=summarise(assembly, completed, tuple(clock.seconds), notes),
        open_at=assembly.open_at,
    )


def _solid(found: Segmentation, settings: Settings, clock: Clock) -> tuple[Completed, Assembly]:
    """The solid of all patches; where none comes of them at once, of those that more than a few points show."""
    completed, assembler = _completed(found.scan, found.patches, clock), Assembler(settings, clock.done)
    if found.plainer is not None:
        assembly = assembler.first(completed)
        if assembly is not None:
            return completed, assembly
        completed = _completed(found.scan, found.plainer, clock)
        warnings.warn("small faces, which only a few points show, were left out: no solid came of them", stacklevel=2)
    return completed, assembler.best(completed)


def _completed(scan: Scan, patches: Sequence[Patch], clock: Clock) -> Completed:
    """The patches on surfaces, and the scan without gaps."""
    fitted = joined(scan, absorbed(scan, fit_patches(scan, patches)))
    clock.done("fit", count_kinds(fitted))
    completed = complete(scan, fitted)
    clock.done("complete", str(completed))
    return completed


def _tolerant(scan: Scan, settings: Settings) -> Scan:
    """The scan with as much noise as the tolerance that the user gives allows for."""
    noise = (settings.tolerance or 0.0) / _FARTHEST / scan.frame.scale
    return replace(scan, noise=max(scan.noise, noise))


def by_network(scan: Scan, settings: Settings, clock: Clock) -> Segmentation:
    """The patches that the network proposes and the refinement settles; the scan with its unevenness as noise."""
    labels = predict(scan.points, scan.normals, Labeller.load(), settings.seed)
    clock.done("network", "types, edges and descriptors of every point")
    found = segment(scan, labels, settings.seed, scan.noise if settings.tolerance else UNEVEN)
    clock.done("segment", f"{len(found.patches)} patches")
    if found.scan.noise > scan.noise:
        off = f"{_FARTHEST * found.scan.noise * scan.frame.scale:.2g} {settings.unit}"
        warnings.warn(f"the surface is uneven: points may lie {off} off their faces (or say --tolerance)", stacklevel=2)
    return found


def count_kinds(fitted: Iterable[FittedPatch]) -> str:
    """"12 planes, 3 cylinders"."""
    counts = Counter(patch.primitive.kind for patch in fitted)
    words = (f"{n} {kind if n == 1 else PLURALS.get(kind, f'{kind}s')}" for kind, n in counts.most_common())
    return ", ".join(words) or "nothing"


@dataclass
class Clock:
    """Times the stages and passes their messages on."""

    progress: Progress
    seconds: list[tuple[str, float]] = field(default_factory=list)
    last: float = field(default_factory=time.perf_counter)

    def done(self, stage: str, message: str) -> None:
        """A stage has ended."""
        now = time.perf_counter()
        self.seconds.append((stage, now - self.last))
        self.last = now
        self.progress(stage, message)
