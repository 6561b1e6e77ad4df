"""Corner clusters: short chains that only the proxy mesh has are contracted to one corner.

Where four faces meet in a point, or a fillet runs out, the labelled mesh shows two corners joined by a short
chain. They are one when the merged corner still fits all of its surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sed2cad.geometry.chains import length
from sed2cad.geometry.contact import Meeting, Side
from sed2cad.geometry.corners import Corner, solve_corner
from sed2cad.geometry.meeting import sides_of
from sed2cad.topology.model import Topology

_FIT = 2e-3  # unit frame: a merged corner may miss its surfaces by this much
_CLOSE_FIT = 5e-4  # by this much where the short chain looks like a real edge
_SHORT = 0.06  # longer chains are never contracted
_NEAR = 0.02  # solved corners closer than this may merge
_TINY = 0.012  # so may the ends of shorter chains
_SAME = 5e-4  # solved corners closer than this are one
_SLIVER = 1e-3  # a narrower face would close up if its short ends were contracted
_FAR = 0.03  # a merged corner moves less than this
_COINCIDENCE = 1e-9  # unit frame: four surfaces do not come so near to one point by chance
_SURE = 1e-5  # corners that were traced as near as this are those of a CAD system's mesh


class CornerClusters:
    """Union-find over the corners of a topology, with the solved position of each cluster."""

    def __init__(self, topology: Topology, sides: Sequence[Side], meetings: Sequence[Meeting]) -> None:
        self._topology = topology
        self._sides = sides
        self._meetings = meetings
        self._parent = list(range(len(topology.corners)))
        self._chains_at: list[set[int]] = [set() for _ in topology.corners]
        self._lengths = [length(c.points, c.closed) for c in topology.chains]
        self.alive = [True] * len(topology.chains)
        for k, chain in enumerate(topology.chains):
            for corner in () if chain.closed else (chain.start, chain.end):
                self._chains_at[corner].add(k)
        self.solved: dict[int, Corner] = {c: self._solve([c]) for c in range(len(topology.corners))}

    def root(self, corner: int) -> int:
        """The cluster of a corner."""
        while self._parent[corner] != corner:
            corner = self._parent[corner]
        return corner

    def labels(self) -> NDArray[np.int64]:
        """The cluster (c,) of each corner."""
        return np.array([self.root(c) for c in range(len(self._parent))], dtype=np.int64)

    def contract(self) -> None:
        """Contract short chains until none qualifies, the shortest first."""
        short = [k for k in np.argsort(self._lengths) if self._contractible(int(k))]
        for _ in range(4):
            done = [self._try(int(k)) for k in short if self.alive[k]]
            if not any(done):
                break

    def _contractible(self, k: int) -> bool:
        return not self._topology.chains[k].closed and self._lengths[k] < _SHORT

    def _try(self, k: int) -> bool:
        """Contract chain k where that is right; whether it was."""
        chain = self._topology.chains[k]
        a, b = self.root(chain.start), self.root(chain.end)
        if a == b:
            if self._lengths[k] < _TINY and self._loops_keep(k, 1):
                self.alive[k] = False
            return False
        apart = float(np.linalg.norm(self.solved[a].position - self.solved[b].position))
        if apart > _SURE and self._is_sure(a) and self._is_sure(b):
            return False
        if not self._loops_keep(k, 1 if apart < _SAME else 2):
            return False
        merged = self._solve([a, b])
        fits = merged.misfit < (_CLOSE_FIT if self._as_traced(k, a, b) else _FIT)
        if apart < _SAME:
            merged = merged if fits else self.solved[a]
        elif not (
            self._crossed(k, a, b, apart, merged)
            or (fits and self._close(k, apart, merged))
            or self._all_meet(a, b, merged)
        ):
            return False
        self._join(k, a, b, merged)
        return True

    def _is_sure(self, cluster: int) -> bool:
        """Whether a corner was traced where its surfaces meet exactly, which is no coincidence."""
        return max(self.solved[cluster].moved, self.solved[cluster].misfit) < _SURE

    def _as_traced(self, k: int, a: int, b: int) -> bool:
        """Whether the solved corners lie to each other as the chain's ends do: a real, short edge."""
        chain = self._topology.chains[k]
        traced = chain.points[-1] - chain.points[0]
        solved = self.solved[b].position - self.solved[a].position
        return bool(np.linalg.norm(solved - traced) < 0.5 * np.linalg.norm(traced))

    def _close(self, k: int, apart: float, merged: Corner) -> bool:
        return merged.moved < _FAR and (apart < _NEAR or self._lengths[k] < _TINY)

    def _crossed(self, k: int, a: int, b: int, apart: float, merged: Corner) -> bool:
        """Whether the solved corners have passed each other, so that the chain would run backwards."""
        chain = self._topology.chains[k]
        way = chain.points[-1] - chain.points[0]
        backwards = (self.solved[b].position - self.solved[a].position) @ way < 0
        return bool(backwards and apart < _FAR and merged.misfit < 4 * _FIT)

    def _all_meet(self, a: int, b: int, merged: Corner) -> bool:
        """Whether the surfaces of two corners all meet in just one of these, which is no coincidence: the other one
        lies where some meet again."""
        sides = [side for _, pair in self._pairs([a, b]) for side in pair]
        at = [self.solved[corner].position[None] for corner in (a, b)]
        off = sorted(max(abs(float(side.primitive.distance(place)[0])) for side in sides) for place in at)
        return max(merged.misfit, off[0]) < _COINCIDENCE and off[1] > _FIT and merged.moved < _FAR

    def _join(self, k: int, a: int, b: int, merged: Corner) -> None:
        self._parent[b] = a
        self._chains_at[a] |= self._chains_at[b]
        self.alive[k] = False
        self.solved[a] = merged

    def _loops_keep(self, k: int, least: int) -> bool:
        """Whether every loop with chain k has at least `least` chains left without it, and stays open."""
        chain = self._topology.chains[k]
        for r in {chain.left, chain.right}:
            region = self._topology.regions[r]
            for loop in region.loops:
                left = [other for other, _ in loop if self.alive[other] and other != k]
                if k not in (other for other, _ in loop):
                    continue
                if len(left) < least:
                    return False
                width = region.area / max(self._lengths[other] for other in left)
                if len(left) <= 2 and len(region.loops) == 1 and width < _SLIVER:
                    return False
        return True

    def _solve(self, clusters: list[int]) -> Corner:
        """The corner of one cluster, or of two were they merged."""
        used: dict[int, Side] = {}
        tangent = []
        resting = False
        for k, pair in self._pairs(clusters):
            chain = self._topology.chains[k]
            used.update((id(side), side) for side in pair)
            resting |= self._meetings[k] == "resting"
            joins = {self.root(chain.start), self.root(chain.end)}
            if self._meetings[k] == "touching" and (len(clusters) == 1 or joins != set(clusters)):
                tangent.append(pair)
        members = [c for c in range(len(self._parent)) if self.root(c) in clusters]
        start = self._topology.corners[members].mean(axis=0)
        return solve_corner(start, list(used.values()), tangent, resting)

    def _pairs(self, clusters: list[int]) -> list[tuple[int, tuple[Side, Side]]]:
        """The chains at clusters that are left, ascending, and the surfaces on both sides of each."""
        chains = set().union(*(self._chains_at[c] for c in clusters))
        alive = sorted(k for k in chains if self.alive[k])
        return [(k, sides_of(self._topology, self._sides, self._topology.chains[k])) for k in alive]
