"""Corners that the proxy mesh shows wrongly: faces in touch that are not, corners of too many faces.

A mesh resolves nothing below its edge length. Where its corner cannot lie on all of its surfaces, it is
split; where the solved ends of a short chain have passed each other, the other two faces are in touch
instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sed2cad.geometry.chains import length
from sed2cad.geometry.contact import Meeting, Side
from sed2cad.geometry.corners import Corner, solve_corner
from sed2cad.geometry.curves import Array
from sed2cad.geometry.web import Web
from sed2cad.topology.model import Topology

_FIT = 2e-3  # unit frame: a corner that misses its surfaces by less stays as it is
_SHORT = 0.04  # unit frame: longer chains do not turn over
_FAR = 0.03  # unit frame: a new corner lies this near to the old one
_ROUNDS = 3
_MOST_RAYS = 8


@dataclass(frozen=True)
class _Split:
    """One way to tear a corner apart."""

    first: int  # numbers of the regions that get in touch
    second: int
    at: Corner
    away: Corner

    @property
    def residual(self) -> float:
        return max(self.at.residual, self.away.residual)


def untangled(topology: Topology, sides: Sequence[Side], meetings: Sequence[Meeting]) -> Topology:
    """The topology with its impossible corners split and its crossed short chains turned over."""
    web = Web(topology)
    resting = {k for k, how in enumerate(meetings) if how != "crossing"}
    for _ in range(_ROUNDS):
        before = len(web.chains)
        for corner in range(len(web.corners)):
            web = _split_if_impossible(web, corner, sides, resting)
        for k in range(len(web.chains)):
            web = _turned_over(web, k, sides, resting)
        if len(web.chains) == before:
            break
    return web.topology()


def _split_if_impossible(web: Web, corner: int, sides: Sequence[Side], smooth: set[int]) -> Web:
    """The web with a corner of more than three faces split, where that mends it."""
    turn = web.turn(corner)
    if not 4 <= len(turn) <= _MOST_RAYS or any(ray[0] in smooth for ray, _ in turn):
        return web
    whole = _solved(web, corner, [region for _, region in turn], sides)
    if whole.residual < _FIT:
        return web
    best = _best_split(web, corner, sides)
    if best is None or best.residual > 0.5 * whole.residual:
        return web
    return web.split(corner, best.first, best.second, best.at.position, best.away.position)


def _turned_over(web: Web, k: int, sides: Sequence[Side], smooth: set[int]) -> Web:
    """The web with the two other faces in touch along a short chain whose solved ends have changed places."""
    chain = web.chains[k]
    if k in web.dead or chain.closed or chain.start == chain.end or length(chain.points, False) > _SHORT:
        return web
    turns = [web.turn(corner) for corner in (chain.start, chain.end)]
    if any(len(turn) != 3 or any(ray[0] in smooth for ray, _ in turn) for turn in turns):
        return web
    start, end = (
        _solved(web, corner, [region for _, region in turn], sides)
        for corner, turn in zip((chain.start, chain.end), turns)
    )
    if (end.position - start.position) @ (chain.points[-1] - chain.points[0]) >= 0:
        return web
    merged = web.contracted(k)
    turn = merged.turn(chain.start)
    if len(turn) != 4 or _solved(merged, chain.start, [r for _, r in turn], sides).residual < _FIT:
        return web
    best = _best_split(merged, chain.start, sides)
    if best is None or best.residual > _FIT:
        return web
    return merged.split(chain.start, best.first, best.second, best.at.position, best.away.position)


def _best_split(web: Web, corner: int, sides: Sequence[Side]) -> _Split | None:
    """The split whose two corners fit best, of those whose new chain runs the right way."""
    turn = web.turn(corner)
    splits = [_split(web, corner, first, second, sides) for first, second in _pairs(len(turn))]
    sound = [s for s in splits if _is_sound(web, corner, s)]
    return min(sound, key=lambda s: s.residual) if sound else None


def _pairs(count: int) -> Iterator[tuple[int, int]]:
    """Numbers of regions around a corner that are not in touch yet."""
    for first in range(count):
        for second in range(first + 2, count):
            if (first, second) != (0, count - 1):
                yield first, second


def _split(web: Web, corner: int, first: int, second: int, sides: Sequence[Side]) -> _Split:
    regions = [region for _, region in web.turn(corner)]
    at = _solved(web, corner, regions[first : second + 1], sides)
    away = _solved(web, corner, regions[second:] + regions[: first + 1], sides)
    return _Split(first, second, at, away)


def _is_sound(web: Web, corner: int, split: _Split) -> bool:
    """Whether the new corners are near, and apart in the way in which their rays go."""
    turn = web.turn(corner)
    if turn[split.first][1] == turn[split.second][1] or max(split.at.moved, split.away.moved) > _FAR:
        return False
    ways = np.array([web.direction(ray) for ray, _ in turn])
    here = np.zeros(len(turn), dtype=bool)
    here[split.first + 1 : split.second + 1] = True
    apart: Array = ways[~here].mean(axis=0) - ways[here].mean(axis=0)
    return bool((split.away.position - split.at.position) @ apart > 0)


def _solved(web: Web, corner: int, regions: Sequence[int], sides: Sequence[Side]) -> Corner:
    """The point on the surfaces of some regions near a corner."""
    numbers = list(dict.fromkeys(web.primitive(region) for region in regions))
    return solve_corner(web.corners[corner], [sides[n] for n in numbers], [])
