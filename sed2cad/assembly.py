"""From fitted patches to a checked solid: trace, regularize, assemble, and the ladder down when that fails.

Every rung is one attempt in a child process with a time limit; the first whose solid passes the gate is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.brep.attempt import AssemblyResult, Attempt, FacetedAttempt, Options, nowhere
from sed2cad.brep.attempt import assemble as exact_solid
from sed2cad.brep.attempt import assemble_faceted as faceted_solid
from sed2cad.brep.gate import Limits
from sed2cad.brep.worker import Failure, run_isolated
from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.names import primitive_names
from sed2cad.regularize import Constraint, regularize
from sed2cad.scan.scan import Frame, Mesh, Scan
from sed2cad.settings import Settings
from sed2cad.topology.faceted import decimate
from sed2cad.topology.model import Topology
from sed2cad.topology.trace import trace

Done = Callable[[str, str], None]

FACETS = "facets"
FACET_COUNTS = (1500, 12_000)  # triangles of the faceted solid: coarse first, finer where that fails the gate


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


@dataclass(frozen=True)
class Rung:
    """One way to trace and assemble the same patches."""

    name: str
    smoothness: float = 1.0  # of the labels on the proxy mesh
    regular: bool = True  # whether parallel, coaxial, ... are made exact


LADDER = (
    Rung("exact"),
    Rung("exact, not regularised", regular=False),
    Rung("exact, smoother borders", smoothness=2.5),
    Rung("exact, rougher borders, not regularised", smoothness=0.4, regular=False),
)


def assemble(scan: Scan, fitted: Sequence[FittedPatch], settings: Settings, done: Done) -> Assembly:
    """The first rung of the ladder that passes the gate; at its end the faceted proxy.

    AssemblyError when nothing closes.
    """
    options = Options(limits=_limits(scan, settings))
    failures: list[str] = []
    proxy: Mesh | None = None
    for rung in LADDER:
        traced = trace(scan, fitted, rung.smoothness, proxy)
        proxy = traced.proxy
        patches, constraints = list(traced.fitted), []
        if rung.regular:
            patches, constraints = regularize(patches, scan.points, traced.topology)
        done("trace", f"{len(traced.topology.regions)} faces, {len(traced.topology.chains)} edges, "
                      f"{len(constraints)} constraints")
        surface = np.vstack([scan.points, proxy.vertices])
        attempt = Attempt(traced.topology, tuple(patches), scan.frame, scan.points, options, surface)
        outcome = run_isolated(exact_solid, attempt, settings.attempt_seconds)
        reason = _fault(outcome)
        done("assemble", f"{rung.name}: {reason or 'closed'}")
        if not reason and isinstance(outcome, AssemblyResult):
            return Assembly(tuple(patches), traced.topology, outcome, face_names(outcome, patches), rung.name,
                            tuple(failures), tuple(constraints))
        failures.append(f"{rung.name}: {reason}")
    assert proxy is not None
    return _facets(scan, proxy, fitted, options, settings, failures, done)


def _facets(
    scan: Scan, proxy: Mesh, fitted: Sequence[FittedPatch], options: Options, settings: Settings,
    failures: list[str], done: Done,
) -> Assembly:
    """The last rung: the proxy mesh as a solid of planar faces."""
    for count in FACET_COUNTS:
        attempt = FacetedAttempt(decimate(proxy, count), scan.frame, scan.points, options)
        outcome = run_isolated(faceted_solid, attempt, settings.attempt_seconds)
        reason = _fault(outcome)
        done("assemble", f"{FACETS}: {reason or 'closed'}")
        if isinstance(outcome, AssemblyResult) and outcome.gate.closed and outcome.gate.valid:
            nothing = Topology((), (), np.zeros((0, 3)), proxy.volume())
            names = face_names(outcome, fitted)
            return Assembly(tuple(fitted), nothing, outcome, names, FACETS, tuple(failures))
        failures.append(f"{FACETS}: {reason}")
    raise AssemblyError(f"no closed solid could be built ({failures[-1]})")


def reassemble(frame: Frame, fitted: Sequence[FittedPatch], topology: Topology) -> AssemblyResult:
    """The same faces, edges and corners on changed surfaces. AssemblyError when that fails."""
    unknown = replace(topology, volume=math.nan)
    attempt = Attempt(unknown, tuple(fitted), frame, nowhere())
    outcome = run_isolated(exact_solid, attempt, Settings().attempt_seconds)
    if isinstance(outcome, Failure):
        raise AssemblyError(outcome.sentence)
    return outcome


def face_names(solid: AssemblyResult, fitted: Sequence[FittedPatch]) -> tuple[str, ...]:
    """The name of the primitive that carries each face of the solid; "facet" where none does."""
    names = primitive_names(fitted)
    return tuple(names[face.primitive] if face.primitive >= 0 else "facet" for face in solid.faces)


def _fault(outcome: AssemblyResult | Failure) -> str:
    """Why an attempt is not good enough; empty when it is."""
    return outcome.sentence if isinstance(outcome, Failure) else outcome.gate.reason


def _limits(scan: Scan, settings: Settings) -> Limits:
    """The gate's limits; a tolerance given by the user says which points are explained."""
    limits = Limits()
    distance = settings.tolerance / scan.frame.scale if settings.tolerance else limits.distance
    return replace(limits, distance=max(distance, 3 * scan.noise))
