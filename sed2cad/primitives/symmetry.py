"""Planes of symmetry: what lies in the middle of more pairs than chance would put there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import pdtrc

from sed2cad.primitives.base import Array
from sed2cad.primitives.images import MIRRORED
from sed2cad.primitives.lattices import is_known, tolerance
from sed2cad.primitives.patterns import Pattern, datum
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.proposals import Pieces
from sed2cad.primitives.relations import EQUATIONS, placement, residuals
from sed2cad.primitives.solve_relations import Relation

_CHANCE = 1e-4  # symmetries as good as one that are expected where places are random
_ALIGNED = 1e-8  # of directions that relations made parallel or perpendicular
_STRAY = 0.1  # votes that are expected near a plane by chance
_ANGLES = (np.radians(0.05), np.radians(0.5))  # least and most that a slope is turned by
_APART = 1e-6  # places nearer than this are one
_STRAIN = 0.5  # of all relations of a symmetry, which was within its tolerances
_LEAST = 2  # pairs, or lone members in the plane


@dataclass(frozen=True)
class Vote:
    """Two pieces, or one twice, that a plane at this height along a direction would map on each other."""

    a: int
    b: int
    height: float
    spread: float  # its standard deviation
    width: float = 0.0  # how far apart they are

    @property
    def slack(self) -> float:
        """How far the plane may be off."""
        return tolerance(self.spread)


def propose_symmetries(pieces: Pieces, sides: Mapping[int, int], first: int) -> list[Pattern]:
    """At most one plane of symmetry across each direction; `pieces` obey the pairwise relations already.

    `sides` says whether the normal of each piece points outwards (1) or inwards (-1). The datums are numbered
    from `first`.
    """
    patterns: list[Pattern] = []

    def kind_of(vote: Vote) -> str:
        return pieces[vote.a].primitive.kind

    for leader in _directions(pieces):
        normal = placement(pieces[leader].primitive)[:3]
        votes = [vote for kind in (_plane_votes, _slope_votes, _centre_votes) for vote in kind(pieces, sides, normal)]
        chosen, height = _elected(votes)
        if not chosen:
            continue
        index = first + len(patterns)
        images = [
            Relation("symmetric", (v.a, v.b, index), MIRRORED[kind_of(v)], strain=abs(v.height - height) / v.slack)
            for v in chosen
        ]
        across = Relation("symmetric", (leader, index), EQUATIONS["parallel"], strain=_STRAIN)
        members = sorted({k for vote in chosen for k in (vote.a, vote.b)})
        middle = datum(Plane(normal, height), "", members, placed=False)
        patterns.append(Pattern("symmetric", tuple(images), (across,), {index: middle}))
    return patterns


def _directions(pieces: Pieces) -> list[int]:
    """One piece for every direction that a plane or an axis has, planes first."""
    leaders: list[int] = []
    for index in sorted(pieces, key=lambda k: pieces[k].primitive.kind != "plane"):
        direction = placement(pieces[index].primitive)[:3]
        if pieces[index].primitive.kind == "sphere":
            continue
        if all(np.linalg.norm(np.cross(placement(pieces[k].primitive)[:3], direction)) > _ALIGNED for k in leaders):
            leaders.append(index)
    return leaders


def _plane_votes(pieces: Pieces, sides: Mapping[int, int], normal: Array) -> Iterator[Vote]:
    """Parallel planes that face opposite ways; of those at one height the best known."""
    known: list[tuple[float, int, int]] = []  # height, way, index
    planes = (k for k, entry in pieces.items() if entry.primitive.kind == "plane")
    for index in sorted(planes, key=lambda k: pieces[k].offset):
        numbers = placement(pieces[index].primitive)
        cosine = float(numbers[:3] @ normal)
        height, way = cosine * numbers[6], int(np.sign(cosine)) * sides[index]
        if 1 - abs(cosine) < _ALIGNED and all(abs(height - h) > _APART or way != w for h, w, _ in known):
            known.append((height, way, index))
    for k, (height, way, index) in enumerate(known):
        for other, opposite, partner in known[:k]:
            if way != opposite and abs(height - other) > _APART:
                spread = float(np.hypot(pieces[index].offset, pieces[partner].offset)) / 2
                yield Vote(partner, index, (height + other) / 2, spread, abs(height - other))


def _slope_votes(pieces: Pieces, sides: Mapping[int, int], normal: Array) -> Iterator[Vote]:
    """Planes neither along nor across the normal, whose outward normals are each other's mirror images."""
    known: list[tuple[int, Array, float]] = []  # index, outward normal, offset along it
    for index, entry in pieces.items():
        numbers = placement(entry.primitive) * sides[index]
        if entry.primitive.kind == "plane" and _ALIGNED < abs(float(numbers[:3] @ normal)) < 1 - _ALIGNED:
            known.append((index, numbers[:3], float(numbers[6])))
    for k, (a, outward, offset) in enumerate(known):
        slope = float(outward @ normal)
        for b, other, partner in known[:k]:
            spread = np.hypot(pieces[a].spread(slice(0, 2)), pieces[b].spread(slice(0, 2)))
            turned = float(np.linalg.norm(outward - 2 * slope * normal - other))
            if turned < max(3 * spread, _ANGLES[0]) < _ANGLES[1]:
                place = np.hypot(pieces[a].spread(slice(2, 3)), pieces[b].spread(slice(2, 3)))
                yield Vote(b, a, (offset - partner) / (2 * slope), float(place) / abs(2 * slope))


def _centre_votes(pieces: Pieces, sides: Mapping[int, int], normal: Array) -> Iterator[Vote]:
    """Axes across the normal and centres: in the plane, or equal ones on both sides of it."""
    known: list[int] = []
    for index in sorted(pieces, key=lambda k: pieces[k].lateral if _has_centre(pieces, k) else 0.0):
        if _has_centre(pieces, index) and _is_placed(pieces, index, normal):
            if not any(_at_one_place(pieces, index, k) for k in known):
                known.append(index)
    for k, index in enumerate(known):
        height = float(placement(pieces[index].primitive)[3:6] @ normal)
        yield Vote(index, index, height, pieces[index].lateral)
        for partner in known[:k]:
            if sides[partner] == sides[index] and _alike(pieces, partner, index):
                other = float(placement(pieces[partner].primitive)[3:6] @ normal)
                middle, width = (height + other) / 2, abs(height - other)
                spread = float(np.hypot(pieces[index].lateral, pieces[partner].lateral))
                if width > _APART and _mirrored(pieces, partner, index, Plane(normal, middle)) < tolerance(spread):
                    yield Vote(partner, index, middle, spread / 2, width)


def _has_centre(pieces: Pieces, index: int) -> bool:
    return pieces[index].primitive.kind != "plane"


def _is_placed(pieces: Pieces, index: int, normal: Array) -> bool:
    """Whether the mirror image of its direction is parallel to it, and it has one height along the normal."""
    kind, direction = pieces[index].primitive.kind, placement(pieces[index].primitive)[:3]
    across = abs(float(direction @ normal)) < _ALIGNED
    along = float(np.linalg.norm(np.cross(direction, normal))) < _ALIGNED
    return kind == "sphere" or across or (along and kind == "torus")


def _at_one_place(pieces: Pieces, a: int, b: int) -> bool:
    """Whether b's axis or centre is a's: then they say the same."""
    p, q = placement(pieces[a].primitive), placement(pieces[b].primitive)
    gap = q[3:6] - p[3:6]
    if p[:3].any() and q[:3].any():
        return bool(np.linalg.norm(np.cross(p[:3], q[:3])) < _ALIGNED and np.linalg.norm(np.cross(gap, p[:3])) < _APART)
    return bool(np.linalg.norm(gap - (gap @ p[:3]) * p[:3]) < _APART)


def _alike(pieces: Pieces, a: int, b: int) -> bool:
    """Whether both are of one kind and size, as relations have made them; cones may still differ a little."""
    p, q = pieces[a].primitive, pieces[b].primitive
    sizes = placement(p)[6:] - placement(q)[6:]
    return p.kind == q.kind and (p.kind == "cone" or bool(np.abs(sizes).max() < _APART))


def _mirrored(pieces: Pieces, a: int, b: int, plane: Plane) -> float:
    """How far b is from being the mirror image of a."""
    stacks = [placement(primitive)[None] for primitive in (pieces[a].primitive, pieces[b].primitive, plane)]
    return float(np.abs(residuals(MIRRORED[pieces[a].primitive.kind], *stacks, np.ones(1))).max())


def _sharp(votes: Iterable[Vote]) -> list[Vote]:
    """Those that are at least so certain that few of them could be near a plane by chance."""
    known = sorted((vote for vote in votes if is_known(vote.spread)), key=lambda vote: vote.spread)
    extent = _extent(known)
    return [vote for k, vote in enumerate(known) if 2 * (k + 1) * vote.slack < _STRAY * extent]


def _extent(votes: Sequence[Vote]) -> float:
    """Of the places that were compared, along the normal."""
    heights = [vote.height for vote in votes] or [0.0]
    return max(max(heights) - min(heights), *(vote.width for vote in votes), 1e-3)


def _elected(votes: Sequence[Vote]) -> tuple[list[Vote], float]:
    """The votes for the plane with the most, if chance does not explain them, and its height.

    No piece votes twice, and none whose place is so uncertain that chance alone would bring in votes like its own.
    """
    votes = _sharp(votes)
    if len(votes) < _LEAST:
        return [], 0.0
    height, slack = np.array([vote.height for vote in votes]), np.array([vote.slack for vote in votes])
    near = np.abs(height[:, None] - height) < np.hypot(slack[:, None], slack)
    among = near[int(np.argmax(near.sum(axis=1)))]
    middle = float(np.average(height[among], weights=slack[among] ** -2.0))
    strain = np.abs(height - middle) / slack
    chosen: list[Vote] = []
    taken: set[int] = set()
    for k in np.argsort(strain)[: int((strain < 1).sum())].tolist():
        if not {votes[k].a, votes[k].b} & taken:
            chosen.append(votes[k])
            taken |= {votes[k].a, votes[k].b}
    expected = len(votes) * 2 * float(slack[strain < 1].mean()) / _extent(votes) if chosen else 0.0
    chance = len(votes) * float(pdtrc(len(chosen) - 2, expected))  # so many others at one vote
    return (chosen, middle) if len(chosen) >= _LEAST and chance < _CHANCE else ([], 0.0)
