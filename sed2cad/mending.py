"""The rung between exact and faceted: only the faces to blame are replaced, the rest stays exact.

A face to blame first gets a freeform surface through its region of the proxy mesh; is it blamed again, it becomes
triangles on the edges of its neighbours, or is left out of a shell that is open anyway.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sed2cad.brep.attempt import AssemblyResult, Attempt, Verdict
from sed2cad.brep.jobs import judge
from sed2cad.brep.worker import Failure
from sed2cad.geometry.necks import without_necks
from sed2cad.geometry.polygons import Cloud
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.loose import loose_among
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Scan
from sed2cad.topology.remedies import remedied
from sed2cad.topology.trace import Traced
from sed2cad.topology.walls import walled

Run = Callable[[Callable[[Attempt], Verdict], Attempt, float], Verdict | Failure]

_MOST_ROUNDS = 24
_TINY = 2e-3  # of the unit area: smaller faces become facets at once
_SMALL = 0.01  # smaller ones are left out of an open shell at once: there are many, and each trial takes seconds
_CLOUD = 3000  # points of a face that its facets follow
_LARGEST = 0.8  # share of the surface: when more is to be replaced, the solid is not worth mending
_CLOSE = 3e-3  # unit frame: rms of a freeform face from its region of the proxy mesh
_FARTHEST = 0.01  # its largest distance


@dataclass
class Mending:
    """The faces replaced so far."""

    base: Attempt
    traced: Traced
    freeform: dict[int, FittedPatch] = field(default_factory=dict)  # by region
    facets: set[int] = field(default_factory=set)  # or left out

    def __str__(self) -> str:
        """"1 freeform, 2 faceted"."""
        smooth, last = len(self.freeform.keys() - self.facets), len(self.facets)
        return f"{smooth} freeform, {last} {'faceted' if self.nothing is None else 'left out'}"

    @property
    def nothing(self) -> int | None:
        """The primitive of what is left out of a shell that is open; None for a solid."""
        return loose_among(self.base.fitted)

    def attempt(self) -> Attempt:
        """The attempt with these faces replaced."""
        regions, fitted = list(self.base.topology.regions), list(self.base.fitted)
        smooth = {r: patch for r, patch in self.freeform.items() if r not in self.facets}
        for r, patch in smooth.items():
            regions[r] = replace(regions[r], primitive=len(fitted))
            fitted.append(patch)
        nothing = self.nothing
        if nothing is not None:
            for r in self.facets:
                regions[r] = replace(regions[r], primitive=nothing)
        return replace(
            self.base,
            topology=replace(self.base.topology, regions=tuple(regions)),
            fitted=tuple(fitted),
            freeform=frozenset(range(len(self.base.fitted), len(fitted))),
            facets={r: self.cloud(r) for r in sorted(self.facets)} if nothing is None else {},
        )

    def cloud(self, region: int) -> Cloud:
        """The region's triangles of the proxy mesh as points with normals."""
        mesh = self.traced.proxy
        own = np.flatnonzero(self.traced.labels == region)
        if len(own) == 0:  # a wall that was put in
            return self.base.cloud(region)
        own = own[np.linspace(0, len(own) - 1, min(len(own), _CLOUD)).astype(np.int64)]
        return Cloud(mesh.centroids()[own], mesh.face_normals()[0][own])

    def replace(self, region: int) -> None:
        """Take the next kind of face for a region."""
        patch = None if region in self.freeform else self._smooth(region)
        if patch is None:
            self.facets.add(region)
        else:
            self.freeform[region] = patch

    def _smooth(self, region: int) -> FittedPatch | None:
        """A freeform surface through a region, where one comes near enough."""
        if self.base.topology.regions[region].area < (_TINY if self.nothing is None else _SMALL):
            return None
        cloud = self.cloud(region)
        surface = fit_bspline(cloud.points, cloud.normals, 5e-4)
        if surface is None:
            return None
        off = np.abs(surface.distance(cloud.points))
        rms = root_mean_square(off)
        if rms > _CLOSE or off.max() > _FARTHEST:
            return None
        nothing = Patch(np.zeros(0, np.int64), "bspline", np.zeros(0, bool))
        return FittedPatch(nothing, surface, surface.side(cloud.points, cloud.normals), rms, np.zeros((0, 0)))

    def replace_all(self, blamed: Sequence[int]) -> bool:
        """Replace the faces to blame; whether there were any and the solid is still worth mending."""
        left = [region for region in blamed if region not in self.facets]
        for region in left:
            self.replace(region)
        return bool(left) and self.share() < _LARGEST

    def misfits(self) -> tuple[int, ...]:
        """Regions whose surface does not even explain their triangles."""
        found = []
        for r, region in enumerate(self.base.topology.regions):
            surface = self.base.fitted[region.primitive].primitive
            off = np.abs(surface.distance(region.points))
            if r not in self.freeform and r not in self.facets and np.median(off) > _FARTHEST:
                found.append(r)
        return tuple(found)

    def share(self) -> float:
        """The share of the surface that is replaced."""
        areas = np.array([region.area for region in self.base.topology.regions])
        return float(areas[sorted(self.facets | set(self.freeform))].sum() / areas.sum())


@dataclass(frozen=True)
class Mended:
    """A solid some of whose faces were replaced, and the attempt that made it."""

    result: AssemblyResult
    attempt: Attempt


@dataclass(frozen=True)
class Flawed:
    """An attempt that failed."""

    attempt: Attempt
    traced: Traced
    verdict: Verdict | None = None  # None: not known yet
    looked: bool = False  # whether it is what a second look gave


def looked_again(scan: Scan, flawed: Flawed, blamed: Sequence[int]) -> Flawed | None:
    """The attempt on the regions that a second look gives; None where nothing changes. AssemblyError."""
    again = remedied(scan, flawed.traced, flawed.attempt.fitted, blamed)
    if again is None:
        return None
    topology, fitted = walled(scan, again.topology, again.fitted)
    topology = without_necks(topology, fitted)
    return Flawed(replace(flawed.attempt, topology=topology, fitted=tuple(fitted)), again, looked=True)


def mend(
    scan: Scan, flawed: Flawed, run: Run, seconds: float, say: Callable[[str], None]
) -> tuple[Mended | None, str]:
    """The solid with the faces to blame replaced, or why that does not pass the gate either."""
    mending, reason = Mending(flawed.attempt, flawed.traced), "no time was left"
    verdict: Verdict | Failure | None = flawed.verdict
    end = time.perf_counter() + seconds
    for _ in range(_MOST_ROUNDS):
        attempt, left = mending.attempt(), end - time.perf_counter()
        if left <= 1:
            break
        if verdict is None:
            verdict = run(judge, attempt, left)
        if isinstance(verdict, Failure):
            return None, verdict.sentence
        reason = verdict.reason
        say(f"{mending}: {reason or 'passed'} {verdict.blamed}")
        if verdict.result is not None and not reason:
            return Mended(verdict.result, attempt), ""
        looked = flawed.looked or mending.nothing is not None
        again = None if looked else looked_again(scan, flawed, verdict.blamed)
        flawed = again or replace(flawed, looked=True)
        if again is not None:
            mending = Mending(again.attempt, again.traced)
        elif not mending.replace_all(mending.misfits() or verdict.blamed):
            break
        verdict = None
    return None, reason
