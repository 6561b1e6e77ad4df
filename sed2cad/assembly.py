"""From fitted patches to a checked solid: the ladder of exact solids and, below it, what is left to do."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sed2cad.brep.attempt import AssemblyResult, Attempt, FacetedAttempt, Opening, Options, nowhere
from sed2cad.brep.jobs import assemble as exact_solid
from sed2cad.brep.jobs import assemble_faceted as faceted_solid
from sed2cad.brep.jobs import opened
from sed2cad.brep.worker import Failure, run_isolated
from sed2cad.climbing import Climb, Done, Trial, fault_of, limits_of
from sed2cad.completion.complete import Completed, Seen
from sed2cad.constraints import Constraint
from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.loose import loose_patch
from sed2cad.primitives.names import primitive_names
from sed2cad.rungs import Tracer
from sed2cad.scan.scan import Frame, Mesh
from sed2cad.settings import Settings
from sed2cad.topology.faceted import decimate
from sed2cad.topology.model import Topology
from sed2cad.topology.sheet import sheet_of

FACETS = "facets"
VARIANT = "variant"
_OPENING_SECONDS = 10.0
_LONGER = 2.0  # times as long as for a solid, for a shell whose faces to blame are left out one after the other
FACET_COUNTS = (1500, 3000, 6000)  # triangles of the faceted solid: coarse first, finer where that fails the gate


@dataclass(frozen=True)
class Assembly:
    """A solid, what it was made from, and how far down the ladder it was found."""

    fitted: tuple[FittedPatch, ...]
    topology: Topology
    solid: AssemblyResult
    face_names: tuple[str, ...]
    rung: str
    failures: tuple[str, ...]  # of the rungs above, in order
    constraints: tuple[Constraint, ...] = ()
    open_at: tuple[int, ...] = ()  # patches whose faces were left out


@dataclass
class Assembler:
    """Makes a solid of what is known of one part. Its time for exact solids begins with it."""

    settings: Settings
    done: Done
    failures: list[str] = field(default_factory=list)  # of all rungs so far, in order
    start: float = field(default_factory=time.perf_counter)

    def first(self, completed: Completed) -> Assembly | None:
        """A solid of exact faces on the first rung; None where there is none."""
        if completed.one_sided:
            return None
        try:
            return self._closed(completed, self._climb(completed, _tracer(completed)).first())
        except AssemblyError as error:
            self.failures.append(str(error))
            return None

    def best(self, completed: Completed) -> Assembly:
        """The first rung of the ladder that passes the gate, without the caps that nobody asked for; at its end facets.

        Where the scan does not show all of the part and no exact solid was found, an open shell of the faces that it
        shows comes before facets, which would only invent the rest, unless a closed solid was asked for. What comes
        back may be open or invalid where even facets fail (its gate says so). AssemblyError when nothing at all could
        be built.
        """
        tracer = _tracer(completed)
        seen = None if self.settings.cap else completed.seen
        ways = [lambda: self._closed(completed, self._climb(completed, tracer).best())]
        if seen is not None:
            ways.insert(0 if completed.one_sided else 1, lambda: self._open_shell(seen))
        for way in ways:
            if (made := way()) is not None:
                return made
        if not tracer.proxies:
            raise AssemblyError(f"no closed surface could be laid through the scan ({self.failures[-1]})")
        return self._facets(completed, next(iter(tracer.proxies.values())))

    def _climb(self, completed: Completed, tracer: Tracer) -> Climb:
        return Climb(tracer, completed.measured, self.settings, self.done, self.failures, start=self.start)

    def _closed(self, completed: Completed, trial: Trial | None) -> Assembly | None:
        """What a trial made, without the caps that nobody asked for. AssemblyError."""
        if trial is None:
            return None
        return _opened(self._made(trial), () if self.settings.cap else completed.caps)

    def _made(self, trial: Trial) -> Assembly:
        """What a trial made."""
        attempt, solid = trial.flawed.attempt, trial.outcome
        assert isinstance(solid, AssemblyResult)
        names, failures = face_names(solid, attempt.fitted), tuple(self.failures)
        return Assembly(attempt.fitted, attempt.topology, solid, names, trial.name, failures, trial.constraints)

    def _open_shell(self, seen: Seen) -> Assembly | None:
        """Only the faces that the scan shows, bounded where it ends; None where they do not pass the gate either."""
        try:
            sheet = sheet_of(seen.scan, seen.fitted)
        except AssemblyError as error:
            self.failures.append(str(error))
            return None
        fitted = [*seen.fitted, loose_patch()]
        tracer = Tracer(seen.scan, fitted, {"carved": sheet.mesh}, unseen=sheet.back)
        longer = replace(self.settings, solid_seconds=_LONGER * self.settings.solid_seconds)
        trial = Climb(tracer, seen.scan.points, longer, self.done, self.failures).best()
        if trial is None:
            return None
        shell = self._made(trial)
        return shell if shell.solid.gate.closed else replace(shell, open_at=(len(seen.fitted),))

    def _facets(self, completed: Completed, proxy: Mesh) -> Assembly:
        """The last rung: the proxy mesh as a solid of planar faces; at worst an open or invalid shell of them."""
        scan, fitted = completed.scan, completed.fitted
        options = Options(limits=limits_of(scan, self.settings))
        nothing = Topology((), (), np.zeros((0, 3)), proxy.volume())
        best: Assembly | None = None
        for count in FACET_COUNTS:
            attempt = FacetedAttempt(decimate(proxy, count), scan.frame, completed.measured, options)
            outcome = run_isolated(faceted_solid, attempt, self.settings.attempt_seconds)
            reason = fault_of(outcome)
            self.done("assemble", f"{FACETS}: {reason or 'closed'}")
            if isinstance(outcome, AssemblyResult) and (best is None or _sound(outcome) >= _sound(best.solid)):
                names = face_names(outcome, fitted)
                best = Assembly(tuple(fitted), nothing, outcome, names, FACETS, tuple(self.failures))
            if not reason:
                break
            self.failures.append(f"{FACETS}: {reason}")
        if best is None:
            raise AssemblyError(f"no closed solid could be built ({self.failures[-1]})")
        return best


def _tracer(completed: Completed) -> Tracer:
    """For the rungs."""
    return Tracer(completed.scan, completed.fitted, {"carved": completed.proxy} if completed.proxy else {})


def _opened(assembly: Assembly, caps: Sequence[int]) -> Assembly:
    """The solid without the faces of some patches: an open shell. AssemblyError when the kernel fails on it."""
    regions = assembly.topology.regions
    of_caps = {number for number, region in enumerate(regions) if region.primitive in caps}
    at = {k for k, face in enumerate(assembly.solid.faces) if face.region in of_caps}
    if not at:
        return assembly
    outcome = run_isolated(opened, Opening(assembly.solid, frozenset(at)), _OPENING_SECONDS)
    if isinstance(outcome, Failure):
        raise AssemblyError(f"the solid could not be opened where the scan ends ({outcome.sentence})")
    names = tuple(name for k, name in enumerate(assembly.face_names) if k not in at)
    return replace(assembly, solid=outcome, face_names=names, open_at=tuple(caps))


def _sound(solid: AssemblyResult) -> bool:
    """Whether it is a closed valid solid, however well it follows the scan."""
    return solid.gate.closed and solid.gate.valid


def reassemble(
    frame: Frame, fitted: Sequence[FittedPatch], topology: Topology, open_at: Sequence[int] = ()
) -> Assembly:
    """The same faces, edges and corners on changed surfaces. AssemblyError where that fails or misses the gate."""
    unknown = replace(topology, volume=math.nan)
    attempt = Attempt(unknown, tuple(fitted), frame, nowhere())
    outcome = run_isolated(exact_solid, attempt, Settings().attempt_seconds)
    if isinstance(outcome, Failure):
        raise AssemblyError(outcome.sentence)
    if not outcome.gate.passed:
        raise AssemblyError(outcome.gate.reason)
    changed = Assembly(tuple(fitted), topology, outcome, face_names(outcome, fitted), VARIANT, ())
    return _opened(changed, open_at)


def face_names(solid: AssemblyResult, fitted: Sequence[FittedPatch]) -> tuple[str, ...]:
    """The name of the primitive that carries each face of the solid; "facet" where none does."""
    names = primitive_names(fitted)
    return tuple(names[face.primitive] if face.primitive >= 0 else "facet" for face in solid.faces)
