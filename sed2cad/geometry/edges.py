"""The curve of one chain: closed form, recognised, or interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.geometry.chains import between, length, off_surfaces, onto_both, resampled, smoothed
from sed2cad.geometry.contact import Meeting, Side
from sed2cad.geometry.curves import Arc, Array, Curve, Interpolated, arc_through
from sed2cad.geometry.intersections import exact_intersections
from sed2cad.geometry.recognise import recognise
from sed2cad.geometry.rulings import common_ruling
from sed2cad.topology.model import Chain

_FAR = 0.05  # unit frame: chain points that would move farther are not trusted
_CONVERGED = 1e-4  # and so are those that did not get onto crossing surfaces
_NEAR = 0.02  # a closed-form curve lies this near to the chain on average
_ENDS = 2e-3  # and this near to the chain's corners
_ASTRAY = 3e-3  # a worse curve may be no better than the traced chain itself
_SMOOTH = 1e-5  # interpolated curves get more points until they are this near to both surfaces
_MET = 1e-7  # unit frame: an edge ends at its corner
_DENSE = 65  # points that tell the length of an arc
_DETOUR = 1.1  # times the length of its chain: a longer arc is not its curve
_FEWEST, _MOST = 12, 72  # points of a chain
_BENT = 17  # points of an exact curve that is bent


@dataclass(frozen=True)
class EdgeGeometry:
    """The curve of one chain, run its way."""

    arc: Arc  # unit frame
    residual: float  # largest distance of the arc from its two surfaces, unit frame


def edge_geometry(chain: Chain, a: Side, b: Side, how: Meeting, corners: Array) -> EdgeGeometry:
    """The curve of a chain between its solved corners (c, 3)."""
    ring = chain.closed and len(chain.points) < _FEWEST  # smoothed as it is it would shrink
    traced = smoothed(resampled(chain.points, _FEWEST, True) if ring else chain.points, chain.closed)
    points = traced if chain.closed else between(traced, corners[chain.start], corners[chain.end])
    count = int(np.clip(len(points), _FEWEST, _MOST))
    points, traced = resampled(points, count, chain.closed), resampled(traced, count, chain.closed)
    curve = _closed_form(a, b, points, how, chain.closed)
    if curve is not None:  # which way around it goes say the points that are not moved with the corners
        along = traced if chain.closed else np.vstack([points[:1], traced[1:-1], points[-1:]])
        return _measured(a, b, curve, along, chain.closed)
    found = _measured(a, b, *_numeric(a, b, points, how, chain.closed), chain.closed)
    ruling = None if chain.closed else common_ruling(a.primitive, b.primitive, points[0], points[-1])
    if ruling is not None:
        straight = _measured(a, b, ruling, points, False)
        if straight.residual < max(found.residual, _ENDS):
            return straight
    if found.residual < _ASTRAY:
        return found
    as_traced = _measured(a, b, Interpolated(points, chain.closed), points, chain.closed)
    return min(found, as_traced, key=lambda edge: edge.residual)


def bent(edge: EdgeGeometry, a: Side, b: Side, start: Array, end: Array) -> EdgeGeometry:
    """An open edge that ends at start and end (3,) exactly, where the curve of its surfaces misses them.

    Three faces and more that do not quite meet in a point make exact curves that end beside it, and cross there.
    """
    first, last = edge.arc.ends()
    if max(np.linalg.norm(first - start), np.linalg.norm(last - end)) < _MET:
        return edge
    curve = edge.arc.curve
    points = curve.points if isinstance(curve, Interpolated) else edge.arc.sampled(_BENT)
    curve = Interpolated(between(points, start, end), False)
    arc = Arc(curve, 0.0, curve.length)
    return EdgeGeometry(arc, float(off_surfaces(a, b, arc.sampled(4 * len(points) + 1)).max()))


def _measured(a: Side, b: Side, curve: Curve, points: Array, closed: bool) -> EdgeGeometry:
    """The arc of a curve along points (n, 3), and how far it is off its surfaces."""
    arc = arc_through(curve, points, closed)
    samples = arc.sampled(4 * len(points) + 1)
    return EdgeGeometry(arc, float(off_surfaces(a, b, samples).max()))


def _closed_form(a: Side, b: Side, points: Array, how: Meeting, closed: bool) -> Curve | None:
    """The exact curve nearest to the chain, where there is one near enough."""
    if how == "resting":
        return None
    candidates = exact_intersections(a.primitive, b.primitive, how == "touching")
    if closed:
        candidates = [curve for curve in candidates if curve.kind != "line"]
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
    if closed:
        return _through(a, b, found[trusted] if trusted.sum() > 3 else points, how, True)
    ends_off = np.linalg.norm(found[[0, -1]] - points[[0, -1]], axis=1)
    trusted[[0, -1]] = False
    inner = found[_in_order(found, trusted, points[0], points[-1], ends_off)]
    if ends_off.max() > _ENDS or len(inner) < 2:
        # the corners lie off the curve: rather all of it a little off than a kink at its ends
        line = np.vstack([found[:1], inner, found[-1:]]) if len(inner) > 1 else points
        found = between(line, points[0], points[-1])
        return recognise(found, False) or Interpolated(found, False), found
    found = np.vstack([points[:1], inner, points[-1:]])
    if how != "crossing" and len(inner) >= 4:
        simple = recognise(inner, False)  # the corners of touching surfaces are not quite on the curve
        if simple is not None and simple.distance(found[[0, -1]]).max() < _ENDS:
            return simple, found
    return _through(a, b, found, how, False)


def _through(a: Side, b: Side, points: Array, how: Meeting, closed: bool) -> tuple[Curve, Array]:
    """The curve through points (n, 3): a simple one, or interpolated as closely as the surfaces ask for."""
    simple = recognise(points, closed)
    if simple is not None and (closed or _runs_straight(simple, points)):
        return simple, points
    points = _refined(a, b, points, how, closed)
    return Interpolated(points, closed), points


def _runs_straight(curve: Curve, points: Array) -> bool:
    """Whether a curve runs along points (n, 3) without detours: a thin ellipse may go around its tip."""
    return length(arc_through(curve, points, False).sampled(_DENSE), False) < _DETOUR * length(points, False)


def _project(a: Side, b: Side, points: Array, how: Meeting) -> tuple[Array, NDArray[np.bool_]]:
    """Points (n, 3) on the common curve, and which of them to trust."""
    projected = onto_both(a, b, points, how)
    trusted = projected.moved < _FAR
    if how == "crossing":
        trusted &= projected.residual < _CONVERGED
    return projected.points, trusted


def _in_order(found: Array, trusted: NDArray[np.bool_], start: Array, end: Array, ends_off: Array) -> list[int]:
    """Indices of trusted points that lie between the corners and make way along the chain.

    They keep as far from a corner as that is off the curve (2,), so that the curve does not turn back to reach it.
    """
    step = length(found, False) / max(len(found) - 1, 1)
    ways = np.gradient(found, axis=0)
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)
    kept: list[int] = []
    last = start
    for k in np.flatnonzero(trusted):
        least = 0.15 * step if kept else max(0.3 * step, ends_off[0])
        early = k < len(found) / 2 or (end - found[k]) @ ways[k] > max(0.3 * step, ends_off[1])
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
        if not closed:  # no curve on both surfaces goes on to a corner that is off them
            sound[[0, -1]] &= off_surfaces(a, b, points[[0, -1]]) < _CONVERGED
        add = np.flatnonzero((projected.moved > _SMOOTH) & sound)
        if len(add) == 0 or len(points) > 400:
            break
        points = np.insert(points, add + 1, projected.points[add], axis=0)
    return points
