"""What the scan does not show is completed: faces go on until they meet, and flat caps close what is left.

A minimum cut chooses among samples of the surfaces around each gap, extended into it, and of caps at which the scan
ends: area on an extended surface is cheap, on a cap dearer, off all surfaces dearest. The samples on the cut join the
points of the scan, so that all later stages see a scan without gaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.completion.caps import Cap, flat_caps
from sed2cad.completion.cut import on_cheapest
from sed2cad.completion.extensions import is_sure, samples_in_ball
from sed2cad.completion.gaps import Gap, find_gaps, joined
from sed2cad.components import linked
from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.edges import surface_samples
from sed2cad.topology.proxy import closed_input, proxy_mesh, proxy_quality
from sed2cad.topology.samples import Samples, on_surfaces, settled_labels

_NONE = 0.3  # share of the points that a proxy misses which is none: what it closes is no gap
_LOOKS = 4  # at the proxy
_GOOD = 0.02  # that a good one may miss; with what completes the scan so many more may be missed
_BETTER = 0.01  # so many less, for another look
_APART = 0.35  # reaches: samples nearer to the scan's points are not needed
_FEW = 4  # points beside a sample that tell whether it runs along a face
_PARALLEL = 0.97  # cosine of the normals from which it does
_LINKED = 1.8  # spacings between neighbouring samples
_LOW = 1.0  # reaches between a cap and the last points of a face that goes on to it
_SLACK = 0.25  # spacings beyond a cap
_DOUBLE = 0.5  # reaches: a cap nearer than this to another surface, for most of it, is not needed
_LEAST = 8  # samples of a cap that is one, and of a piece of a face that goes on


@dataclass(frozen=True)
class Seen:
    """A scan and its patches as they were before anything was added."""

    scan: Scan
    fitted: list[FittedPatch]


@dataclass(frozen=True)
class Completed:
    """A scan and its patches with points where the scan shows none."""

    scan: Scan
    fitted: list[FittedPatch]
    caps: tuple[int, ...] = ()  # indices of the patches that only close a gap
    proxy: Mesh | None = None  # None where none was found
    added: int = 0  # points at the end of the scan's that were not measured
    unclosed: int = 0  # gaps that the faces around them do not close
    missed: float = 0.0  # share of the measured points that the proxy misses; all where there is none
    seen: Seen | None = None  # where the scan does not show all of the part

    @property
    def one_sided(self) -> bool:
        """Whether no closed surface lies near the points, as where one side of walls was seen only."""
        return self.missed > _NONE

    @property
    def measured(self) -> Array:
        """The points (n, 3) of the scan that were measured."""
        return self.scan.points[: len(self.scan.points) - self.added]

    def __str__(self) -> str:
        """"faces were extended and 1 flat cap was added"."""
        if self.one_sided:
            return "no closed surface lies near its points"
        if not self.added and not self.unclosed:
            return "the scan shows all of the part"
        said = []
        if self.added:
            capped = f" and {_counted(len(self.caps), 'flat cap')} added" if self.caps else ""
            said.append(f"faces were extended{capped}")
        if self.unclosed:
            said.append(f"{_counted(self.unclosed, 'gap')} only bridged: no face that it shows leads across")
        return "; ".join(said)


def _counted(count: int, thing: str) -> str:
    """"1 flat cap was"."""
    return f"{count} {thing}{'s were' if count > 1 else ' was'}"


def complete(scan: Scan, fitted: Sequence[FittedPatch]) -> Completed:
    """The scan with its gaps closed, the largest first. A closed mesh has none.

    A proxy that misses points may show gaps where there are none: then the largest is closed before the next look.
    """
    own = closed_input(scan)
    whole = Completed(scan, list(fitted), proxy=own)
    if own is not None:
        return whole
    whole = _with_proxy(whole)
    first = _gaps(whole)
    for look in range(_LOOKS):
        gaps = _gaps(whole) if look else first
        if not gaps:
            break
        good = whole.missed < _GOOD
        part = _Part(whole, len(fitted))
        for gap in joined(gaps if good else gaps[:1]):
            part.close(gap)
        more = _with_proxy(part.whole()) if len(part.found) else None
        if more is None or more.missed > whole.missed + _GOOD:
            whole = replace(whole, unclosed=len(joined(gaps)))
            break
        done = good or more.missed > whole.missed - _BETTER
        whole = more
        if done:
            break
    return replace(whole, seen=Seen(scan, list(fitted)) if first or whole.one_sided else None)


def _gaps(completed: Completed) -> list[Gap]:
    """The gaps that the proxy shows, the largest first."""
    if completed.proxy is None or completed.one_sided:
        return []
    return find_gaps(completed.scan, completed.proxy)


def _with_proxy(completed: Completed) -> Completed:
    """The same with a proxy, if there is one: another rung of the ladder may find one."""
    try:
        mesh = proxy_mesh(completed.scan, completed.fitted)
    except AssemblyError:
        return replace(completed, missed=1.0)
    scan, count = completed.scan, len(completed.measured)
    measured = replace(scan, points=scan.points[:count], normals=scan.normals[:count])
    return replace(completed, proxy=mesh, missed=proxy_quality(mesh, measured))


@dataclass
class _Part:
    """What is known of a part, and found in its gaps so far."""

    completed: Completed  # so far
    measured: int  # patches of the scan; the others are caps
    patches: list[FittedPatch] = field(init=False)
    owner: NDArray[np.int64] = field(init=False)  # (n,) patch of each point of the scan, -1 for none
    faces: Samples = field(init=False)  # of what the scan shows and of what was found
    found: Samples = field(init=False)

    def __post_init__(self) -> None:
        scan = self.completed.scan
        self.patches = list(self.completed.fitted)
        self.owner = settled_labels(scan, self.patches)
        self.faces = surface_samples(scan, self.patches)
        self.found = self.faces[:0]

    @property
    def scan(self) -> Scan:
        """With the points that were added before."""
        return self.completed.scan

    def close(self, gap: Gap) -> None:
        """Find the samples that close a gap."""
        caps = flat_caps(self.scan, gap, self.patches)
        gap = self._with_feet(gap, caps)
        around = [k for k in self._beside(gap) if not self.patches[k].primitive.freeform]
        around += range(len(self.patches), len(self.patches) + len(caps))
        self.patches += [cap.patch for cap in caps]
        candidates = self._candidates(gap, around, caps)
        if len(candidates) == 0:
            return
        more = _without_crumbs(on_cheapest(self.scan, gap, self.faces, candidates, self.measured), gap.spacing)
        more = self._without_doubles(more, gap.reach)
        labels = more.labels[:, 0]
        more = Samples.within_faces(more.points, labels, on_surfaces(more.points, labels, self.patches)[1])
        self.found += more
        self.faces += more

    def _with_feet(self, gap: Gap, caps: Sequence[Cap]) -> Gap:
        """The gap with all points in its rim whose face ends at a cap near by, as those of bores do."""
        feet = np.zeros(len(self.scan.points), dtype=bool)
        for cap in caps:
            distance, across = cap.patch.primitive.distance_and_normal(self.scan.points)
            along = np.abs(np.einsum("ij,ij->i", across, self.scan.normals)) > _PARALLEL
            feet |= (np.abs(distance) < _LOW * gap.reach) & ~along
        feet &= np.linalg.norm(self.scan.points - gap.centre, axis=1) < gap.around
        return replace(gap, rim=np.union1d(gap.rim, np.flatnonzero(feet)))

    def _beside(self, gap: Gap) -> list[int]:
        """The patches of the rim, and the caps of other gaps that come near."""
        near = np.linalg.norm(self.faces.points - gap.centre, axis=1) < gap.radius + gap.reach
        labels = self.faces.labels[near, 0]
        beside = np.union1d(self.owner[gap.rim], labels[labels >= self.measured])
        return [k for k in beside.tolist() if k >= 0]

    def _candidates(self, gap: Gap, around: Sequence[int], caps: Sequence[Cap]) -> Samples:
        """Samples, without normals, of the patches around a gap where these have none yet, up to the caps."""
        points: list[Array] = []
        shown = cKDTree(self.faces.points)
        for k in around:
            surface = self.patches[k].primitive
            more = samples_in_ball(surface, gap.centre, gap.around, gap.spacing)
            for cap in caps:
                if cap.ends(surface):
                    more = more[cap.is_within(more, _SLACK * gap.spacing)]
            own = self.faces.points[(self.faces.labels == k).any(axis=1)]
            if len(own):
                away, _ = cKDTree(own).query(more, workers=-1)
                more = more[away > _APART * gap.reach]
                more = more[is_sure(self.patches[k], more, own)]
                more = more[~self._is_shown(shown, k, more, gap.reach)]
                more = more[_reached(more, self.scan.points[gap.rim], gap)]
            points.append(more)
        labels = np.repeat(np.array(around, dtype=np.int64), [len(more) for more in points])
        together = np.vstack([np.zeros((0, 3)), *points])
        return Samples.within_faces(together, labels, np.zeros_like(together))

    def _is_shown(self, tree: cKDTree, own: int, points: Array, reach: float) -> NDArray[np.bool_]:
        """Which samples (n, 3) of a patch run along another one that the scan shows, as where both have one surface;
        tree: of the points of the faces."""
        if len(points) == 0:
            return np.zeros(0, dtype=bool)
        off, at = tree.query(points, k=_FEW)
        outwards = self.patches[own].sign * self.patches[own].primitive.normal(points)
        along = np.einsum("ij,ikmj->ikm", outwards, self.faces.normals[at]).min(axis=2) > _PARALLEL
        other = (self.faces.labels[at] != own).all(axis=2)
        return np.asarray(((off < reach) & along & other).any(axis=1))

    def _without_doubles(self, found: Samples, reach: float) -> Samples:
        """The samples without caps that mostly run along another surface, as the tangent plane of a bore does."""
        labels = found.labels[:, 0]
        others = np.vstack([self.faces.points, found.points[labels < self.measured]])
        off, _ = cKDTree(others).query(found.points)
        caps = np.unique(labels[labels >= self.measured])
        double = [k for k in caps if np.median(off[labels == k]) < _DOUBLE * reach]
        return found[~np.isin(labels, double)]

    def whole(self) -> Completed:
        """The scan with what was found as points of its patches."""
        scan, known, labels = self.scan, len(self.completed.fitted), self.found.labels[:, 0]
        counts = np.bincount(labels, minlength=len(self.patches))
        kept = [k for k in range(len(self.patches)) if k < known or counts[k] >= _LEAST]
        found = self.found[np.isin(labels, kept)]
        labels = found.labels[:, 0]
        fitted = [_with_points(self.patches[k], len(scan.points) + np.flatnonzero(labels == k)) for k in kept]
        points, normals = np.vstack([scan.points, found.points]), np.vstack([scan.normals, found.normals[:, 0]])
        scan = replace(scan, points=points, normals=normals, mesh=None, part=None, triangle=None)
        caps = tuple(range(self.measured, len(fitted)))
        return Completed(scan, fitted, caps, None, self.completed.added + len(found))


def _without_crumbs(found: Samples, spacing: float) -> Samples:
    """The samples that hang together with some others of their patch: what few of them bridge, needs no bridge."""
    _, part = linked(np.column_stack([found.points, found.labels[:, 0]]), _LINKED * spacing)  # which is far below 1
    return found[np.bincount(part)[part] >= _LEAST]


def _with_points(patch: FittedPatch, more: NDArray[np.int64]) -> FittedPatch:
    """The patch with more points, which its surface is not fitted to."""
    indices = np.concatenate([patch.patch.indices, more])
    interior = np.concatenate([patch.patch.interior, np.zeros(len(more), dtype=bool)])
    return replace(patch, patch=replace(patch.patch, indices=indices, interior=interior))


def _reached(points: Array, rim: Array, gap: Gap) -> NDArray[np.bool_]:
    """Which samples (n, 3) of a face hang together with some that are near the rim (m, 3): not the mouths of bores."""
    if len(points) == 0:
        return np.zeros(0, dtype=bool)
    _, part = linked(points, _LINKED * gap.spacing)
    off, _ = cKDTree(rim).query(points)
    return np.isin(part, np.unique(part[off < gap.reach]))
