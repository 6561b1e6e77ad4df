"""Corners that the proxy mesh shows wrongly: faces in touch that are not, corners of too many faces.

A mesh resolves nothing below its edge length. Where its corner cannot lie on all of its surfaces, it is
split; where the solved ends of a short chain have passed each other or there are none, the other two faces are in
touch instead. A fillet that runs out a little before the faces at its end goes on to them.
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
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.torus import Torus
from sed2cad.topology.model import Topology

_FIT = 2e-3  # unit frame: a corner that misses its surfaces by less stays as it is
_TORN = 3e-4  # unit frame: three crossing surfaces that miss their corner by more have none
_BETTER = 0.2  # of that is left where other faces are in touch
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
    smooth = {k for k, how in enumerate(meetings) if how != "crossing"}
    touching = {k for k, how in enumerate(meetings) if how == "touching"}
    for _ in range(_ROUNDS):
        before = web
        for corner in range(len(web.corners)):
            web = _split_if_impossible(web, corner, sides, smooth)
        for k in range(len(web.chains)):
            web = _continued(web, k, sides, touching)
        for k in range(len(web.chains)):
            web = _turned_over(web, k, sides, smooth)
        if web is before:
            break
    return web.topology()


def _split_if_impossible(web: Web, corner: int, sides: Sequence[Side], smooth: set[int]) -> Web:
    """The web with a corner of more than three faces split, where that mends it.

    A short chain at the corner may have to go for it: it then joins what a neck of a face keeps apart.
    """
    turn = web.turn(corner)
    if not _is_plain(turn, smooth, 4):
        return web
    off = _solved(web, corner, [region for _, region in turn], sides).residual
    if off < _FIT:
        return web
    found = [_mended(web, corner, sides)]
    for (k, end), _ in turn:
        chain = web.chains[k]
        other = chain.start if end else chain.end
        if _is_short(web, k) and _is_plain(web.turn(other), smooth, 3):
            found.append(_mended(web.contracted(k), chain.start, sides))
    return _simplest(web, found, 0.5 * off)


def _turned_over(web: Web, k: int, sides: Sequence[Side], smooth: set[int]) -> Web:
    """The web with the two other faces in touch along a short chain whose solved ends have changed places, or which
    its surfaces leave no place for."""
    if k in web.dead or not _is_short(web, k):
        return web
    chain = web.chains[k]
    turns = [web.turn(corner) for corner in (chain.start, chain.end)]
    if not all(_is_plain(turn, smooth, 3) and len(turn) == 3 for turn in turns):
        return web
    start, end = (
        _solved(web, corner, [region for _, region in turn], sides)
        for corner, turn in zip((chain.start, chain.end), turns)
    )
    torn = max(start.residual, end.residual)
    in_order = (end.position - start.position) @ (chain.points[-1] - chain.points[0]) >= 0
    if in_order and torn < _TORN:
        return web
    merged = web.contracted(k)
    regions = [region for _, region in merged.turn(chain.start)]
    least, most = (_TORN, _BETTER * torn) if torn >= _TORN else (_FIT, _FIT)
    if not regions or _solved(merged, chain.start, regions, sides).residual < least:
        return web
    return _simplest(web, [_mended(merged, chain.start, sides)], most)


def _continued(web: Web, k: int, sides: Sequence[Side], touching: set[int]) -> Web:
    """The web with the fillet that ends at a short chain, between the faces that it touches, going on along it: a
    fillet has one radius and does not run out."""
    if k in web.dead or k in touching or not _is_short(web, k):
        return web
    chain = web.chains[k]
    for corner in (chain.start, chain.end):
        turn = web.turn(corner)
        fillets = [region for _, region in turn if region not in (chain.left, chain.right)]
        if len(turn) == 3 and len(fillets) == 1 and all(ray[0] in touching for ray, _ in turn if ray[0] != k):
            if isinstance(sides[web.primitive(fillets[0])].primitive, Cylinder | Torus):
                return _spread(web.contracted(k), chain.start, fillets[0], sides)
    return web


def _spread(web: Web, corner: int, region: int, sides: Sequence[Side]) -> Web:
    """The web with a region in touch with all others around a corner."""
    while len(turn := [other for _, other in web.turn(corner)]) > 3 and turn.count(region) == 1:
        first = turn.index(region)
        between, second = ((first + k) % len(turn) for k in (1, 2))
        here, there = [region, turn[between], turn[second]], turn[:between] + turn[between + 1 :]
        at, away = (_solved(web, corner, regions, sides).position for regions in (here, there))
        web = web.split(corner, first, second, at, away)
        corner = len(web.corners) - 1
    return web


def _is_plain(turn: Sequence[tuple[tuple[int, int], int]], smooth: set[int], least: int) -> bool:
    """Whether a corner has enough faces, not too many, and only edges where surfaces cross."""
    return least <= len(turn) <= _MOST_RAYS and not any(ray[0] in smooth for ray, _ in turn)


def _is_short(web: Web, k: int) -> bool:
    """Whether a chain is short enough to be a flaw of the mesh."""
    chain = web.chains[k]
    return not chain.closed and chain.start != chain.end and length(chain.points, False) < _SHORT


def _mended(web: Web, corner: int, sides: Sequence[Side]) -> tuple[Web, float] | None:
    """The web with a corner split in the best way, and how far the two new ones are off their surfaces."""
    best = _best_split(web, corner, sides)
    if best is None:
        return None
    return web.split(corner, best.first, best.second, best.at.position, best.away.position), best.residual


def _simplest(web: Web, found: Sequence[tuple[Web, float] | None], limit: float) -> Web:
    """Of the mended webs with corners off by less than `limit` the one with the fewest chains, or `web`."""
    good = [entry for entry in found if entry is not None and entry[1] < limit]
    if not good:
        return web
    fewest = min(len(mended.chains) - len(mended.dead) for mended, _ in good)
    simple = [entry for entry in good if len(entry[0].chains) - len(entry[0].dead) == fewest]
    return min(simple, key=lambda entry: entry[1])[0]


def _best_split(web: Web, corner: int, sides: Sequence[Side]) -> _Split | None:
    """The split whose two corners fit best, of those whose new chain runs the right way."""
    turn = web.turn(corner)
    regions = [region for _, region in turn]
    splits = [_split(web, corner, first, second, sides) for first, second in _pairs(regions)]
    sound = [s for s in splits if _is_sound(web, corner, s)]
    return min(sound, key=lambda s: s.residual) if sound else None


def _pairs(regions: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Numbers of the regions around a corner that are not in touch there yet."""
    count = len(regions)
    touching = {frozenset((a, b)) for a, b in zip(regions, [*regions[1:], regions[0]])}
    for first in range(count):
        for second in range(first + 2, count):
            if frozenset((regions[first], regions[second])) not in touching:
                yield first, second


def _split(web: Web, corner: int, first: int, second: int, sides: Sequence[Side]) -> _Split:
    regions = [region for _, region in web.turn(corner)]
    at = _solved(web, corner, regions[first : second + 1], sides)
    away = _solved(web, corner, regions[second:] + regions[: first + 1], sides)
    return _Split(first, second, at, away)


def _is_sound(web: Web, corner: int, split: _Split) -> bool:
    """Whether the new corners are near, and apart in the way in which their rays go."""
    turn = web.turn(corner)
    if max(split.at.moved, split.away.moved) > _FAR:
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
