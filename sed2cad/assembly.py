"""From fitted patches to a checked solid: trace, regularize, assemble, and the ladder down when that fails.

Every rung is one attempt in a child process with a time limit; the first whose solid passes the gate is taken.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.brep.attempt import AssemblyResult, Attempt, FacetedAttempt, Limits, Opening, Options, nowhere
from sed2cad.brep.jobs import assemble as exact_solid
from sed2cad.brep.jobs import assemble_faceted as faceted_solid
from sed2cad.brep.jobs import judge, opened
from sed2cad.brep.worker import Failure, run_isolated, warm_up
from sed2cad.completion.complete import Completed
from sed2cad.errors import AssemblyError
from sed2cad.geometry.necks import without_necks
from sed2cad.mending import Flawed, looked_again, mend
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.names import primitive_names
from sed2cad.regularize import Constraint, regularize
from sed2cad.rungs import LADDER, RAW_LADDER, UNREGULARISED, Rung, Tracer
from sed2cad.scan.scan import Array, Frame, Mesh, Scan
from sed2cad.settings import Settings
from sed2cad.topology.faceted import decimate
from sed2cad.topology.model import Topology

Done = Callable[[str, str], None]

FACETS = "facets"
MENDED = "mended"
VARIANT = "variant"
_MENDED = 2  # trials that are tried to be mended, those with the fewest faces to blame
_OPENING_SECONDS = 10.0
_LEAST_SECONDS = 12.0  # of an attempt, and of mending, however late
_APART = 4.0  # spacings: so far from the next point lie some places on the surface of a random scan
_MANY = 100_000  # points: for so many and more all limits are twice as long, as tracing takes its time
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


def assemble(completed: Completed, settings: Settings, done: Done) -> Assembly:
    """The first rung of the ladder that passes the gate, without the caps that nobody asked for."""
    assembly = assemble_closed(completed, settings, done)
    if settings.cap or assembly.rung == FACETS:
        return assembly
    return _opened(assembly, completed.caps)


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


def assemble_closed(completed: Completed, settings: Settings, done: Done) -> Assembly:
    """The first rung of the ladder that passes the gate; at its end one with faces that cannot be drawn, or facets.

    What comes back may be open or invalid where even that fails (its gate says so). AssemblyError when nothing at
    all could be built.
    """
    scan, fitted = completed.scan, completed.fitted
    failures: list[str] = []
    trials: list[Trial] = []
    tracer = Tracer(scan, fitted, {"carved": completed.proxy} if completed.proxy else {})
    start = time.perf_counter()
    for rung in LADDER if settings.regularize else RAW_LADDER:
        if tracer.proxies and _late(scan, settings, start):
            failures.append(f"{rung.name}: not tried, the time for exact solids was over")
            break
        try:
            if not tracer.applies(rung) or (rung.name == UNREGULARISED and trials and trials[0].impossible):
                continue
            for trial in _tries(rung, tracer, completed.measured, settings, start, done, not trials):
                reason = _fault(trial.outcome)
                done("assemble", f"{trial.name}: {reason or 'closed'}")
                if not reason:
                    return _assembly(trial, failures)
                failures.append(f"{trial.name}: {reason}")
                trials.append(trial)
                warm_up(2)
        except AssemblyError as error:
            failures.append(f"{rung.name}: {error}")
            done("assemble", failures[-1])
    if not tracer.proxies:
        raise AssemblyError(f"no closed surface could be laid through the scan ({failures[-1]})")
    seconds = min(settings.attempt_seconds * _patience(scan), _left(scan, settings, start))
    mended = _mended(scan, trials, seconds, failures, done)
    if mended is not None:
        return mended
    almost = [trial for trial in trials if trial.undrawn]
    if almost:
        return _assembly(min(almost, key=lambda trial: trial.undrawn), failures)
    return _facets(completed, next(iter(tracer.proxies.values())), settings, failures, done)


@dataclass(frozen=True)
class Trial:
    """One rung tried."""

    name: str  # of the rung
    flawed: Flawed  # what was tried, if it was not good enough
    outcome: AssemblyResult | Failure
    constraints: tuple[Constraint, ...]

    @property
    def blamed(self) -> tuple[int, ...]:
        """Regions whose faces are to blame, as far as that is known."""
        return self.flawed.verdict.blamed if self.flawed.verdict else ()

    @property
    def flaws(self) -> float:
        """How many faces are to blame, as far as that is known; infinite where there is nothing to mend."""
        if isinstance(self.outcome, Failure):
            return 1.5 * len(self.blamed) or math.inf
        return len(self.blamed) or 99.0

    @property
    def impossible(self) -> bool:
        """Whether the topology allows no solid at all, on whatever surfaces."""
        return isinstance(self.outcome, Failure) and self.outcome.kind == "error"

    @property
    def undrawn(self) -> int:
        """How many faces CAD programs may fail to draw, of a solid that is right but for these."""
        return 0 if isinstance(self.outcome, Failure) else self.outcome.gate.undrawn


def _tries(
    rung: Rung, tracer: Tracer, judges: Array, settings: Settings, start: float, done: Done, twice: bool
) -> Iterator[Trial]:
    """What becomes of a rung and, if asked for and in time, of a second look at what is to blame. AssemblyError."""
    trial = _attempt(rung, tracer, judges, settings, start, done)
    yield trial
    scan = tracer.scan
    if twice and trial.blamed and not trial.undrawn and not _late(scan, settings, start):
        again = looked_again(scan, trial.flawed, trial.blamed)
        if again is not None:
            seconds = min(settings.attempt_seconds, _left(scan, settings, start))
            yield _tried(f"{trial.name}, second look", again, trial.constraints, seconds)


def _attempt(
    rung: Rung, tracer: Tracer, judges: Array, settings: Settings, start: float, done: Done
) -> Trial:
    """One rung of an assembly that began at `start`; its solid is judged by points (n, 3)."""
    scan, traced = tracer.scan, tracer.trace(rung)
    topology, patches = tracer.walled(rung)
    constraints: list[Constraint] = []
    if rung.regular:
        step = settings.round / scan.frame.scale if settings.round else None
        patches, constraints = regularize(scan, patches, topology, step)
    topology = without_necks(topology, patches)
    faces, edges = len(topology.regions), len(topology.chains)
    done("trace", f"{faces} faces, {edges} edges, {len(constraints)} constraints")
    surface = np.vstack([scan.points, traced.proxy.vertices])
    options = Options(limits=_limits(scan, settings))
    attempt = Attempt(topology, tuple(patches), scan.frame, judges, options, surface)
    seconds = min(settings.attempt_seconds, _left(scan, settings, start))
    return _tried(rung.name, Flawed(attempt, traced), tuple(constraints), seconds)


def _tried(name: str, flawed: Flawed, constraints: tuple[Constraint, ...], seconds: float) -> Trial:
    """What the kernel makes of an attempt."""
    verdict = run_isolated(judge, flawed.attempt, seconds)
    if isinstance(verdict, Failure):
        return Trial(name, flawed, verdict, constraints)
    outcome = verdict.result or Failure("error", verdict.reason)
    return Trial(name, replace(flawed, verdict=verdict), outcome, constraints)


def _late(scan: Scan, settings: Settings, start: float) -> bool:
    """Whether an assembly that began at `start` has had its time for exact solids."""
    return time.perf_counter() - start > settings.exact_seconds * _patience(scan)


def _left(scan: Scan, settings: Settings, start: float) -> float:
    """Seconds left of an assembly that began at `start`; some there always are."""
    patience = _patience(scan)
    return max(settings.solid_seconds * patience - (time.perf_counter() - start), _LEAST_SECONDS * patience)


def _patience(scan: Scan) -> float:
    """How much longer than usual the limits are: from 1 for usual scans to 2 for dense ones."""
    return 1.0 + min(len(scan.points) / _MANY, 1.0)


def _mended(
    scan: Scan, trials: Sequence[Trial], seconds: float, failures: list[str], done: Done
) -> Assembly | None:
    """The trial with the fewest faces to blame, those replaced; None where that does not pass either."""
    hopeful = sorted((t for t in trials if t.flaws < math.inf), key=lambda t: t.flaws)[:_MENDED]
    end = time.perf_counter() + seconds
    for trial in hopeful:
        warm_up(2)

        def say(message: str) -> None:
            done("assemble", f"{MENDED}: {message}")

        left = (end - time.perf_counter()) / 2 if trial is not hopeful[-1] else end - time.perf_counter()
        try:
            mended, reason = mend(scan, trial.flawed, run_isolated, left, say)
        except AssemblyError as error:
            mended, reason = None, str(error)
        if mended is not None:
            flawed = replace(trial.flawed, attempt=mended.attempt)
            return _assembly(replace(trial, name=MENDED, flawed=flawed, outcome=mended.result), failures)
        failures.append(f"{MENDED}: {reason}")
    return None


def _assembly(trial: Trial, failures: Sequence[str]) -> Assembly:
    """What a trial made."""
    attempt, solid = trial.flawed.attempt, trial.outcome
    assert isinstance(solid, AssemblyResult)
    names = face_names(solid, attempt.fitted)
    return Assembly(attempt.fitted, attempt.topology, solid, names, trial.name, tuple(failures), trial.constraints)


def _facets(
    completed: Completed, proxy: Mesh, settings: Settings, failures: list[str], done: Done
) -> Assembly:
    """The last rung: the proxy mesh as a solid of planar faces; at worst an open or invalid shell of them."""
    scan, fitted = completed.scan, completed.fitted
    options = Options(limits=_limits(scan, settings))
    nothing = Topology((), (), np.zeros((0, 3)), proxy.volume())
    best: Assembly | None = None
    for count in FACET_COUNTS:
        attempt = FacetedAttempt(decimate(proxy, count), scan.frame, completed.measured, options)
        outcome = run_isolated(faceted_solid, attempt, settings.attempt_seconds)
        reason = _fault(outcome)
        done("assemble", f"{FACETS}: {reason or 'closed'}")
        if isinstance(outcome, AssemblyResult) and (best is None or _sound(outcome) >= _sound(best.solid)):
            names = face_names(outcome, fitted)
            best = Assembly(tuple(fitted), nothing, outcome, names, FACETS, tuple(failures))
        if not reason:
            break
        failures.append(f"{FACETS}: {reason}")
    if best is None:
        raise AssemblyError(f"no closed solid could be built ({failures[-1]})")
    return best


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


def _fault(outcome: AssemblyResult | Failure) -> str:
    """Why an attempt is not good enough; empty when it is."""
    return outcome.sentence if isinstance(outcome, Failure) else outcome.gate.reason


def _limits(scan: Scan, settings: Settings) -> Limits:
    """The gate's limits: a tolerance given by the user says which points are explained; points may be far apart."""
    limits = Limits()
    distance = settings.tolerance / scan.frame.scale if settings.tolerance else limits.distance
    stray = max(limits.stray, _APART * scan.spacing)
    return replace(limits, distance=max(distance, 3 * scan.noise), stray=stray)
