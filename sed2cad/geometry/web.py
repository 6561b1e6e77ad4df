"""A topology that can be edited: corners merged and split, chains doubled, loops kept in step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.geometry.curves import Array
from sed2cad.topology.model import Chain, Region, Topology

Ray = tuple[int, int]  # (chain, 0 for its start | 1 for its end): a chain as seen from the corner there
_REACH = 0.03  # unit frame: how far along a chain its way from the corner is looked at


class Web:
    """Chains, loops and corners of a topology, to be changed step by step. Edits give a new web."""

    def __init__(self, topology: Topology) -> None:
        self._topology = topology
        self.chains = list(topology.chains)
        self.corners = list(topology.corners)
        self.loops = [[list(loop) for loop in region.loops] for region in topology.regions]
        self.dead: set[int] = set()

    def copy(self) -> Web:
        """An independent copy."""
        other = Web(self._topology)
        other.chains, other.corners, other.dead = list(self.chains), list(self.corners), set(self.dead)
        other.loops = [[list(loop) for loop in loops] for loops in self.loops]
        return other

    def topology(self) -> Topology:
        """The topology as it is now; contracted chains are gone."""
        alive = [k for k in range(len(self.chains)) if k not in self.dead]
        number = {k: n for n, k in enumerate(alive)}
        regions = tuple(
            replace(region, loops=tuple(tuple((number[k], w) for k, w in loop) for loop in loops if loop))
            for region, loops in zip(self._topology.regions, self.loops)
        )
        corners = np.array(self.corners).reshape(-1, 3)
        return Topology(regions, tuple(self.chains[k] for k in alive), corners, self._topology.volume)

    def primitive(self, region: int) -> int:
        """The surface of a region."""
        return self._topology.regions[region].primitive

    def corner_of(self, ray: Ray) -> int:
        """The corner from which a ray starts."""
        chain = self.chains[ray[0]]
        return chain.end if ray[1] else chain.start

    def turn(self, corner: int) -> list[tuple[Ray, int]]:
        """The rays of a corner in order, each with the region between it and the next; [] if that fails."""
        following: dict[Ray, tuple[Ray, int]] = {}
        for region, loops in enumerate(self.loops):
            for loop in loops:
                for (k, way), (k2, way2) in zip(loop, loop[1:] + loop[:1]):
                    arriving, leaving = (k, int(way > 0)), (k2, int(way2 < 0))
                    if self.corner_of(arriving) == corner:
                        following[arriving] = leaving, region
        found: list[tuple[Ray, int]] = []
        ray = next(iter(following), None)
        while ray in following and len(found) < len(following):
            after, region = following[ray]
            found.append((ray, region))
            ray = after
        return found if len({ray for ray, _ in found}) == len(following) else []

    def direction(self, ray: Ray) -> Array:
        """The way (3,) that a ray takes from its corner."""
        points = self.chains[ray[0]].points
        points = points[::-1] if ray[1] else points
        far = np.flatnonzero(np.linalg.norm(points - points[0], axis=1) > _REACH)
        way: Array = points[far[0] if len(far) else -1] - points[0]
        return way

    def contracted(self, k: int) -> Web:
        """The web without chain k, its ends one corner."""
        other = self.copy()
        chain = self.chains[k]
        other.dead.add(k)
        other.corners[chain.start] = (self.corners[chain.start] + self.corners[chain.end]) / 2
        for loops in other.loops:
            for loop in loops:
                loop[:] = [step for step in loop if step[0] != k]
        other._move(chain.end, chain.start, [n for n in range(len(self.chains)) if n != k])
        return other

    def doubled(self, k: int, one: Array, two: Array, between: Region) -> Web:
        """The web with a new region along chain k, whose loops this makes.

        The chain, now through `one`, stays with its left region; its double through `two` goes to the right one.
        """
        other, chain = self.copy(), self.chains[k]
        new, double = len(self.loops), len(self.chains)
        other._topology = replace(self._topology, regions=(*self._topology.regions, between))
        other.chains[k] = replace(chain, points=one, right=new)
        other.chains.append(replace(chain, points=two, left=new))
        for loop in other.loops[chain.right]:
            loop[:] = [(double, way) if n == k else (n, way) for n, way in loop]
        other.loops.append([[(k, -1)], [(double, 1)]] if chain.closed else [[(double, 1), (k, -1)]])
        return other

    def beside(self, k: int, region: int) -> int:
        """The region on the other side of a chain."""
        chain = self.chains[k]
        return chain.right if chain.left == region else chain.left

    def can_pinch(self, k: int, corner: int, region: int) -> bool:
        """Whether chain k and a corner are on one loop, or two, of a region that has no further ones."""
        here = [loop for loop in self.loops[region] if k in (n for n, _ in loop) or self._arriving(loop, corner)]
        return len(here) == len(self.loops[region])

    def pinched(self, k: int, corner: int, region: int) -> Web:
        """The web in which chain k runs through a corner on the other side of the region beside it.

        The loops of the region are joined there; or, where chain and corner are on one, it is cut in two, and what lies
        behind the neck is a new region.
        """
        other, chain = self.copy(), self.chains[k]
        second = k if chain.closed else len(self.chains)
        other._cut(k, corner)
        other.loops = [[_replaced(loop, k, second) for loop in loops] for loops in other.loops]
        way = next(w for loop in self.loops[region] for n, w in loop if n == k)
        coming = (k, 1) if way > 0 else (second, 0)
        (going,) = (ray for loop in self.loops[region] for ray in self._arriving(loop, corner))
        before = len(other.loops[region])
        other._relink(region, coming, going)
        if len(other.loops[region]) > before:
            other._part(region, other.loops[region].pop())
        return other

    def _arriving(self, loop: list[tuple[int, int]], corner: int) -> list[Ray]:
        """The rays by which a loop comes to a corner."""
        rays = [(k, int(way > 0)) for k, way in loop]
        return [ray for ray in rays if self.corner_of(ray) == corner]

    def _cut(self, k: int, corner: int) -> None:
        """Let a chain run through a corner: a ring starts there, any other one becomes two."""
        chain, at = self.chains[k], self.corners[corner]
        nearest = int(np.linalg.norm(chain.points - at, axis=1).argmin())
        if chain.closed:
            turned = np.roll(chain.points, -nearest, axis=0)[1:]
            self.chains[k] = replace(chain, points=np.vstack([at, turned, at]), start=corner, end=corner)
            return
        inner = int(np.clip(nearest, 1, max(len(chain.points) - 2, 1)))
        first, rest = chain.points[:inner], chain.points[min(inner + 1, len(chain.points) - 1) :]
        self.chains[k] = replace(chain, points=np.vstack([first, at]), end=corner)
        self.chains.append(replace(chain, points=np.vstack([at, rest]), start=corner))

    def _part(self, region: int, loop: list[tuple[int, int]]) -> None:
        """Make a new region of a loop of another one, and of the points that are nearer to it than to the others."""
        whole, new = self._topology.regions[region], len(self.loops)
        mine, theirs = (
            cKDTree(np.vstack([self.chains[k].points for k, _ in steps])).query(whole.points)[0]
            for steps in (loop, [step for rest in self.loops[region] for step in rest])
        )
        part, left = whole.points[mine < theirs], whole.points[mine >= theirs]
        share = len(part) / max(len(whole.points), 1)
        regions = list(self._topology.regions)
        regions[region] = replace(whole, points=left, area=(1 - share) * whole.area)
        regions.append(replace(whole, points=part, area=share * whole.area))
        self._topology = replace(self._topology, regions=tuple(regions))
        self.loops.append([loop])
        for k, way in loop:
            chain = self.chains[k]
            self.chains[k] = replace(chain, left=new) if way > 0 else replace(chain, right=new)

    def without_ring(self, k: int) -> Web:
        """The web without a closed chain, a hole in both its regions."""
        other = self.copy()
        other.dead.add(k)
        for region in (self.chains[k].left, self.chains[k].right):
            other.loops[region] = [loop for loop in other.loops[region] if loop[0][0] != k]
        return other

    def united(self, k: int) -> Web:
        """The web without chain k: the newest region, on one side of it, becomes part of the one on the other."""
        other, new = self.copy(), len(self.loops) - 1
        old = self.beside(k, new)
        other.dead.add(k)
        rings = [next(loop for loop in other.loops[r] if k in (n for n, _ in loop)) for r in (old, new)]
        turned = [_ending_with(ring, next(step for step in ring if step[0] == k))[:-1] for ring in rings]
        rest = [loop for r in (old, new) for loop in other.loops[r] if loop is not rings[0] and loop is not rings[1]]
        other.loops[old] = [turned[0] + turned[1], *rest]
        other.loops.pop()
        other._topology = replace(self._topology, regions=self._topology.regions[:-1])
        for n, chain in enumerate(other.chains):
            left, right = (old if r == new else r for r in (chain.left, chain.right))
            other.chains[n] = replace(chain, left=left, right=right)
        return other

    def split(self, corner: int, first: int, second: int, at: Array, away: Array) -> Web:
        """The web with a corner torn into two, the regions number `first` and `second` of its turn in touch.

        They get a chain between them; or, where both are one region, its neck there opens.
        `at` (3,) is the corner of the rays after the first region up to the second, `away` that of the
        others.
        """
        turn = self.turn(corner)
        other = self.copy()
        other.corners[corner] = at
        other.corners.append(away)
        new = len(other.corners) - 1
        here = {turn[n % len(turn)][0] for n in range(first + 1, _after(first, second, len(turn)) + 1)}
        for ray, _ in turn:
            if ray not in here:
                k, end = ray
                chain = other.chains[k]
                other.chains[k] = replace(chain, end=new) if end else replace(chain, start=new)
        right, left = turn[first][1], turn[second][1]
        if left == right:
            other._relink(left, turn[first][0], turn[second][0])
            return other
        other.chains.append(Chain(np.linspace(at, away, 4), left, right, corner, new))
        added = len(other.chains) - 1
        other._insert(right, turn[first][0], (added, -1))
        other._insert(left, turn[second][0], (added, 1))
        return other

    def _relink(self, region: int, one: Ray, two: Ray) -> None:
        """Let the ways through a corner after two arriving rays change places: a neck of the region opens."""
        loops = self.loops[region]
        a, b = ((ray[0], 1 if ray[1] else -1) for ray in (one, two))
        with_a = next(loop for loop in loops if a in loop)
        with_b = next(loop for loop in loops if b in loop)
        loops[:] = [loop for loop in loops if loop is not with_a and loop is not with_b]
        turned = _ending_with(with_a, a)
        if with_a is with_b:
            cut = turned.index(b) + 1
            loops += [turned[:cut], turned[cut:]]
        else:
            loops.append(turned + _ending_with(with_b, b))

    def _insert(self, region: int, arriving: Ray, step: tuple[int, int]) -> None:
        """Put a step into a region's loop after the step that arrives by a ray."""
        before = (arriving[0], 1 if arriving[1] else -1)
        for loop in self.loops[region]:
            if before in loop:
                loop.insert(loop.index(before) + 1, step)
                return

    def _move(self, old: int, new: int, chains: list[int]) -> None:
        """Let chains that end at one corner end at another."""
        for k in chains:
            chain = self.chains[k]
            if old in (chain.start, chain.end):
                start, end = (new if c == old else c for c in (chain.start, chain.end))
                self.chains[k] = replace(chain, start=start, end=end)


def _replaced(loop: list[tuple[int, int]], k: int, second: int) -> list[tuple[int, int]]:
    """The loop in which chain k is followed by its second part."""
    if second == k:
        return loop
    both = {1: [(k, 1), (second, 1)], -1: [(second, -1), (k, -1)]}
    return [step for n, way in loop for step in (both[way] if n == k else [(n, way)])]


def _after(first: int, second: int, count: int) -> int:
    """`second` counted on from `first`."""
    return second if second > first else second + count


def _ending_with(loop: list[tuple[int, int]], step: tuple[int, int]) -> list[tuple[int, int]]:
    """The loop turned so that a step is its last."""
    cut = loop.index(step) + 1
    return loop[cut:] + loop[:cut]
