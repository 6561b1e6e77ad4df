"""From a traced topology to exact corners and edge curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.geometry.chains import between, length, off_surfaces, onto_both, resampled, smoothed
from sed2cad.geometry.contact import Meeting, Side
from sed2cad.geometry.curves import Arc, Array, Curve, Interpolated, arc_through
from sed2cad.geometry.intersections import exact_intersections
from sed2cad.geometry.meeting import meeting
from sed2cad.geometry.merging import CornerClusters
from sed2cad.geometry.recognise import recognise
from sed2cad.geometry.untangle import untangled
from sed2cad.primitives.base import FittedPatch
from sed2cad.topology.model import Chain, Topology

_FAR = 0.05  # unit frame: chain points that would move farther are not trusted
_CONVERGED = 1e-4  # and so are those that did not get onto crossing surfaces
_NEAR = 0.02  # a closed-form curve lies this near to the chain on average
_ENDS = 2e-3  # and this near to the chain's corners
_SMOOTH = 1e-5  # interpolated curves get more points until they are this near to both surfaces


@dataclass(frozen=True)
class EdgeGeometry:
    """The curve of one chain, run its way."""

    arc: Arc  # unit frame
    residual: float  # largest distance of the arc from its two surfaces, unit frame


@dataclass(frozen=True)
class Realised:
    """The exact geometry of a topology, unit frame."""

    topology: Topology  # the given one with its impossible corners mended
    corners: Array  # (c, 3): where each corner went
    clusters: NDArray[np.int64]  # (c,): corners of the same number have become one
    corner_residuals: Array  # (c,): largest distance of each corner from its surfaces
    edges: tuple[EdgeGeometry | None, ...]  # one per chain; None where the chain was contracted to its corner


def realise(topology: Topology, fitted: Sequence[FittedPatch]) -> Realised:
    """Move every corner onto all of its surfaces and every chain onto both of its own."""
    sides = [Side.of(patch) for patch in fitted]
    topology = untangled(topology, sides, _meetings(topology, sides))
    pairs = [_sides_of(topology, sides, chain) for chain in topology.chains]
    meetings = _meetings(topology, sides)
    clusters = CornerClusters(topology, sides, meetings)
    clusters.contract()
    labels = clusters.labels()
    corners = np.array([clusters.solved[c].position for c in labels]).reshape(-1, 3)
    edges = [
        _edge(chain, a, b, how, corners) if alive else None
        for chain, (a, b), how, alive in zip(topology.chains, pairs, meetings, clusters.alive)
    ]
    residuals = np.array([clusters.solved[c].residual for c in labels])
    return Realised(topology, corners, labels, residuals, tuple(edges))


def _meetings(topology: Topology, sides: Sequence[Side]) -> list[Meeting]:
    """How the surfaces of each chain meet."""
    return [meeting(*_sides_of(topology, sides, chain), chain.points) for chain in topology.chains]


def _sides_of(topology: Topology, sides: Sequence[Side], chain: Chain) -> tuple[Side, Side]:
    """The surfaces left and right of a chain."""
    return sides[topology.regions[chain.left].primitive], sides[topology.regions[chain.right].primitive]


def _edge(chain: Chain, a: Side, b: Side, how: Meeting, corners: Array) -> EdgeGeometry:
    """The curve of a chain between its solved corners."""
    points = smoothed(chain.points, chain.closed)
    if not chain.closed:
        points = between(points, corners[chain.start], corners[chain.end])
    points = resampled(points, int(np.clip(len(points), 12, 72)), chain.closed)
    curve = _closed_form(a, b, points, how, chain.closed)
    if curve is None:
        curve, points = _numeric(a, b, points, how, chain.closed)
    arc = arc_through(curve, points, chain.closed)
    samples = arc.sampled(4 * len(points) + 1)
    return EdgeGeometry(arc, float(off_surfaces(a, b, samples).max()))


def _closed_form(a: Side, b: Side, points: Array, how: Meeting, closed: bool) -> Curve | None:
    """The exact curve nearest to the chain, where there is one near enough."""
    if how == "resting":
        return None
    candidates = exact_intersections(a.primitive, b.primitive, how == "touching")
    if not candidates:
        return None
    distances = [curve.distance(points) for curve in candidates]
    best = int(np.argmin([d.mean() for d in distances]))
    at_ends = 0.0 if closed else max(distances[best][0], distances[best][-1])
    near = distances[best].mean() < _NEAR and at_ends < _ENDS
    return candidates[best] if near else None


def _numeric(a: Side, b: Side, points: Array, how: Meeting, closed: bool) -> tuple[Curve, Array]:
    """The recognised or interpolated curve of a chain, and its points in order."""
    found, trusted = _project(a, b, points, how)
    if trusted.mean() < 0.6 and how != "resting":
        how = "resting"  # the surfaces miss each other here: the curve midway between them
        found, trusted = _project(a, b, points, how)
    if trusted.sum() < 3:
        found, trusted = points, np.ones(len(points), dtype=bool)
    if closed:
        found = found[trusted]
        core = found
    else:
        trusted[[0, -1]] = False
        inner = found[_in_order(found, trusted, points[0], points[-1])]
        found = np.vstack([points[:1], inner, points[-1:]])
        core = inner if len(inner) >= 4 else found
    simple = recognise(found, closed)
    if simple is None and how != "crossing":  # the corners of touching surfaces are not quite on the curve
        simple = recognise(core, closed)
    if simple is not None and (closed or simple.distance(found[[0, -1]]).max() < _ENDS):
        return simple, found
    found = _refined(a, b, found, how, closed)
    return Interpolated(found, closed), found


def _project(a: Side, b: Side, points: Array, how: Meeting) -> tuple[Array, NDArray[np.bool_]]:
    projected = onto_both(a, b, points, how)
    trusted = projected.moved < _FAR
    if how == "crossing":
        trusted &= projected.residual < _CONVERGED
    return projected.points, trusted


def _in_order(found: Array, trusted: NDArray[np.bool_], start: Array, end: Array) -> list[int]:
    """Indices of trusted points that lie between the corners and make way along the chain."""
    step = length(found, False) / max(len(found) - 1, 1)
    ways = np.gradient(found, axis=0)
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)
    kept: list[int] = []
    last = start
    for k in np.flatnonzero(trusted):
        least = 0.15 * step if kept else 0.3 * step
        early = k < len(found) / 2 or (end - found[k]) @ ways[k] > 0.3 * step
        if (found[k] - last) @ ways[k] > least and early:
            kept.append(int(k))
            last = found[k]
    return kept


def _refined(a: Side, b: Side, points: Array, how: Meeting, closed: bool) -> Array:
    """More points (m, 3) where the interpolated curve leaves the surfaces between its points."""
    if how == "resting" or len(points) < 4:
        return points
    for _ in range(3):
        curve = Interpolated(points, closed)
        middles = curve.at((curve.knots[1:] + curve.knots[:-1]) / 2)
        projected = onto_both(a, b, middles, how)
        sound = (projected.moved < 0.25 * np.diff(curve.knots)) & (projected.residual < _CONVERGED)
        add = np.flatnonzero((projected.moved > _SMOOTH) & sound)
        if len(add) == 0 or len(points) > 400:
            break
        points = np.insert(points, add + 1, projected.points[add], axis=0)
    return points
