"""The ladder of exact solids: every rung is one attempt in a child process with a time limit, two at a time.

The first whose solid passes the gate is taken; where none does, the faces to blame are replaced.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from sed2cad.brep.attempt import AssemblyResult, Attempt, Limits, Options, Verdict
from sed2cad.brep.beside import Crew
from sed2cad.brep.jobs import judge
from sed2cad.brep.worker import Failure, warm_up
from sed2cad.constraints import Constraint
from sed2cad.errors import AssemblyError
from sed2cad.geometry.necks import without_necks
from sed2cad.mending import Flawed, Mended, looked_again, mend
from sed2cad.regularize import regularize
from sed2cad.rungs import LADDER, RAW_LADDER, UNREGULARISED, Rung, Tracer
from sed2cad.scan.scan import Array, Scan
from sed2cad.settings import Settings

Done = Callable[[str, str], None]

MENDED = "mended"
_BESIDE = 2  # trials at a time; so many, those with the fewest faces to blame, are tried to be mended
_LEAST_SECONDS = 12.0  # of an attempt, and of mending, however late
_OPEN_COVERAGE = 0.8  # share of the points that must be explained by an open shell: faces may be missing
_APART = 4.0  # spacings: so far from the next point lie some places on the surface of a random scan
_MANY = 100_000  # points: for so many and more all limits are twice as long, as tracing takes its time


@dataclass(frozen=True)
class Trial:
    """One rung tried."""

    name: str  # of the rung
    flawed: Flawed  # what was tried, if it was not good enough
    outcome: AssemblyResult | Failure
    constraints: tuple[Constraint, ...]

    @property
    def fault(self) -> str:
        """Why it is not good enough; empty when it is."""
        return fault_of(self.outcome)

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


@dataclass(frozen=True)
class _Prepared:
    """What the kernel can try."""

    flawed: Flawed
    constraints: tuple[Constraint, ...]


@dataclass(frozen=True)
class _Begun:
    """What the kernel is at work on."""

    name: str
    prepared: _Prepared
    verdict: Future[Verdict | Failure]

    def ended(self) -> Trial:
        """What becomes of it; waits for that."""
        verdict, flawed, constraints = self.verdict.result(), self.prepared.flawed, self.prepared.constraints
        if isinstance(verdict, Failure):
            return Trial(self.name, flawed, verdict, constraints)
        outcome = verdict.result or Failure("error", verdict.reason)
        return Trial(self.name, replace(flawed, verdict=verdict), outcome, constraints)


@dataclass
class Climb:
    """One way up the ladder. Its time begins with it."""

    tracer: Tracer
    judges: Array  # (n, 3) points that the solids are judged by
    settings: Settings
    done: Done
    failures: list[str]  # of the rungs so far
    trials: list[Trial] = field(default_factory=list)
    start: float = field(default_factory=time.perf_counter)

    def first(self) -> Trial | None:
        """The solid on the first rung, if it passes the gate."""
        return self._passing(self._rungs[:1])

    def best(self) -> Trial | None:
        """The first solid that passes the gate; at the end one with faces that cannot be drawn, or None."""
        found = self._passing(self._rungs)
        if found is not None or not self.tracer.proxies:
            return found
        return self._mended() or min((t for t in self.trials if t.undrawn), key=lambda t: t.undrawn, default=None)

    @property
    def _rungs(self) -> Sequence[Rung]:
        return LADDER if self.settings.regularize else RAW_LADDER

    def _passing(self, rungs: Sequence[Rung]) -> Trial | None:
        """What passes the gate first; what does not is kept among the trials."""
        with Crew(_BESIDE) as crew:
            for trial in self._tries(rungs, crew):
                self.done("assemble", f"{trial.name}: {trial.fault or self._passed}")
                if not trial.fault:
                    return trial
                self.failures.append(f"{trial.name}: {trial.fault}")
                self.trials.append(trial)
                if len(self.trials) == 1:
                    warm_up(_BESIDE)  # one was enough so far
        return None

    @property
    def _passed(self) -> str:
        return "open where the scan ends" if self.tracer.is_open else "closed"

    def _tries(self, rungs: Sequence[Rung], crew: Crew) -> Iterator[Trial]:
        """What becomes of the rungs, in order, and of a second look at what is to blame on the first of them.

        That one is tried alone, as it mostly passes; from then on the next is made ready while the kernel is at work.
        """
        begun: deque[_Begun] = deque()
        for rung in rungs:
            if self.tracer.proxies and self._late():
                self.failures.append(f"{rung.name}: not tried, the time for exact solids was over")
                break
            begun += self._begun(rung.name, partial(self._attempt, rung), crew)
            while len(begun) >= (_BESIDE if self.trials else 1):
                trial = begun.popleft().ended()
                yield trial
                if len(self.trials) == 1:
                    begun += self._begun(f"{trial.name}, second look", partial(self._second_look, trial), crew)
        while begun:
            yield begun.popleft().ended()

    def _begun(self, name: str, prepared: Callable[[], _Prepared | None], crew: Crew) -> list[_Begun]:
        """The kernel at work on what was prepared; nothing where there is nothing to try."""
        try:
            ready = prepared()
        except AssemblyError as error:
            self.failures.append(f"{name}: {error}")
            self.done("assemble", self.failures[-1])
            return []
        if ready is None:
            return []
        attempt, seconds = ready.flawed.attempt, min(self.settings.attempt_seconds, self._left())
        return [_Begun(name, ready, crew.begin(lambda: crew.run(judge, attempt, seconds)))]

    def _attempt(self, rung: Rung) -> _Prepared | None:
        """One rung; None where it would do no better than those before it. AssemblyError."""
        hopeless = rung.name == UNREGULARISED and self.trials and self.trials[0].impossible
        if hopeless or not self.tracer.applies(rung):
            return None
        scan, traced = self.tracer.scan, self.tracer.trace(rung)
        topology, patches = self.tracer.walled(rung)
        constraints: list[Constraint] = []
        if rung.regular:
            step = self.settings.round / scan.frame.scale if self.settings.round else None
            patches, constraints = regularize(scan, patches, topology, step)
        topology = without_necks(topology, patches)
        faces, edges = len(topology.regions), len(topology.chains)
        self.done("trace", f"{faces} faces, {edges} edges, {len(constraints)} constraints")
        surface = np.vstack([scan.points, traced.proxy.vertices])
        limits = limits_of(scan, self.settings)
        if self.tracer.is_open:
            limits = replace(limits, coverage=_OPEN_COVERAGE)
        options = Options(limits=limits)
        attempt = Attempt(topology, tuple(patches), scan.frame, self.judges, options, surface)
        return _Prepared(Flawed(attempt, traced), tuple(constraints))

    def _second_look(self, trial: Trial) -> _Prepared | None:
        """A closed part with another look at what is to blame; None where it shows nothing new. AssemblyError."""
        if not trial.blamed or trial.undrawn or self.tracer.is_open or self._late():
            return None
        again = looked_again(self.tracer.scan, trial.flawed, trial.blamed)
        return None if again is None else _Prepared(again, trial.constraints)

    def _mended(self) -> Trial | None:
        """The trial with the fewest faces to blame, those replaced; None where that does not pass either."""
        hopeful = sorted((t for t in self.trials if t.flaws < math.inf), key=lambda t: t.flaws)
        hopeful = hopeful[: 1 if self.tracer.is_open else _BESIDE]  # what is left out of a shell ends it at last
        seconds = min(self.settings.attempt_seconds * _patience(self.tracer.scan), self._left())
        with Crew(_BESIDE) as crew:
            begun = [crew.begin(partial(self._mend, trial, crew, seconds)) for trial in hopeful]
            for trial, running in zip(hopeful, begun):
                mended, reason = running.result()
                if mended is not None:
                    flawed = replace(trial.flawed, attempt=mended.attempt)
                    return replace(trial, name=MENDED, flawed=flawed, outcome=mended.result)
                self.failures.append(f"{MENDED}: {reason}")
        return None

    def _mend(self, trial: Trial, crew: Crew, seconds: float) -> tuple[Mended | None, str]:
        """What mending makes of a trial, or why not."""
        try:
            return mend(
                self.tracer.scan,
                trial.flawed,
                crew.run,
                seconds,
                lambda message: self.done("assemble", f"{MENDED}: {message}"),
            )
        except AssemblyError as error:
            return None, str(error)

    def _late(self) -> bool:
        """Whether it has had its time for exact solids."""
        return time.perf_counter() - self.start > self.settings.exact_seconds * _patience(self.tracer.scan)

    def _left(self) -> float:
        """Seconds left; some there always are."""
        patience = _patience(self.tracer.scan)
        left = self.settings.solid_seconds * patience - (time.perf_counter() - self.start)
        return max(left, _LEAST_SECONDS * patience)


def _patience(scan: Scan) -> float:
    """How much longer than usual the limits are: from 1 for usual scans to 2 for dense ones."""
    return 1.0 + min(len(scan.points) / _MANY, 1.0)


def fault_of(outcome: AssemblyResult | Failure) -> str:
    """Why what came of an attempt is not good enough; empty when it is."""
    return outcome.sentence if isinstance(outcome, Failure) else outcome.gate.reason


def limits_of(scan: Scan, settings: Settings) -> Limits:
    """The gate's limits: a tolerance given by the user says which points are explained; points may be far apart."""
    limits = Limits()
    distance = settings.tolerance / scan.frame.scale if settings.tolerance else limits.distance
    stray = max(limits.stray, _APART * scan.spacing)
    return replace(limits, distance=max(distance, 3 * scan.noise), stray=stray)
