"""Bolt circles, rows and grids of equal holes, as relations that go through a datum.

A datum is a primitive that no point has seen: the pitch circle of a bolt circle as a cylinder about its centre,
the pitch of a row as a cylinder along it whose radius is the pitch, the plane of a symmetry. It is solved with
the others, and can be coaxial, parallel or rounded like them.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.images import SHIFTED, TURNED, on_circle
from sed2cad.primitives.lattices import Lattice, best_lattice, is_known, tolerances
from sed2cad.primitives.proposals import Piece, Pieces
from sed2cad.primitives.relations import EQUATIONS, placement
from sed2cad.primitives.solve_relations import Evidence, Relation
from sed2cad.primitives.vectors import tangent_frame

_SAME = 1e-8  # of what relations made equal
_STRAIN = 0.5  # of all relations of a pattern, which was within its tolerances
_ROW_ANGLE = np.radians(1.0)  # most between a row and a plane that it is to be parallel to


@dataclass(frozen=True)
class Datum(Piece):
    """A primitive that holds a pattern together; no points pull at it."""

    measure: str = ""  # what its radius is a dimension of: pitch_radius, pitch
    patches: tuple[int, ...] = ()  # the pattern that it belongs to
    placed: bool = True  # whether it has a place, not just a direction and a length

    def spoiled_by(self, moved: Primitive) -> bool:
        """Nothing can."""
        return False


@dataclass(frozen=True)
class Pattern:
    """Equal primitives that repeat."""

    kind: str  # bolt_circle, linear_pattern, grid_pattern, symmetric
    images: tuple[Relation, ...]  # one member is the image of another
    others: tuple[Relation, ...]  # what holds the datums in place
    datums: Mapping[int, Datum]
    detail: str = ""  # "every 60 degrees"

    @property
    def relations(self) -> tuple[Relation, ...]:
        """All of them."""
        return self.images + self.others

    def is_whole(self, kept: Container[Relation]) -> bool:
        """Whether enough of the relations are among the kept ones for it to say anything."""
        return sum(relation in kept for relation in self.images) >= (3 if self.kind == "grid_pattern" else 2)


@dataclass(frozen=True)
class Sites:
    """Equal primitives with parallel axes, seen along these."""

    indices: Sequence[int]  # (n,) the best known one at each place
    frame: Array  # (3, 3) rows: two directions across the axes, and theirs
    places: Array  # (n, 2) in the first two
    spread: Array  # (n,) standard deviations
    kind: str = field(default="cylinder")

    def without(self, members: Sequence[int]) -> Sites:
        """The other places."""
        rest = [k for k in range(len(self.indices)) if k not in members]
        return replace(
            self, indices=[self.indices[k] for k in rest], places=self.places[rest], spread=self.spread[rest]
        )


def datum(primitive: Primitive, measure: str, patches: Sequence[int], placed: bool = True) -> Datum:
    """A primitive without points."""
    nothing = Evidence(np.zeros((0, 3)), np.zeros(0))
    covariance = np.zeros((primitive.freedom, primitive.freedom))
    return Datum(primitive, nothing, covariance, measure, tuple(sorted(patches)), placed)


def propose_patterns(pieces: Pieces, sides: Mapping[int, int], first: int) -> list[Pattern]:
    """Bolt circles, rows and grids; `pieces` obey the pairwise relations already.

    `sides` says whether the normal of each piece points outwards (1) or inwards (-1): a pin is no hole. The
    datums are numbered from `first`.
    """
    patterns: list[Pattern] = []
    for sites in _all_sites(pieces, sides):
        axes = _axes(pieces, sites)
        while len(sites.indices) >= 3:
            centres = np.array([place for _, place, _ in axes]).reshape(-1, 2)
            found = best_lattice(sites.places, sites.spread, centres, np.array([s for _, _, s in axes]))
            if found is None:
                break
            make = _bolt_circle if found.turns else _grid
            patterns.append(make(pieces, sites, found, first, axes))
            first += len(patterns[-1].datums)
            sites = sites.without(found.members.tolist())
    return patterns


def _all_sites(pieces: Pieces, sides: Mapping[int, int]) -> Iterator[Sites]:
    """Cylinders with one radius, and cones that a shift across their axes makes one."""
    groups: list[list[int]] = []
    spread = {k: entry.lateral for k, entry in pieces.items() if entry.primitive.kind in ("cylinder", "cone")}
    for index in sorted((k for k in spread if is_known(spread[k])), key=lambda k: spread[k]):
        for group in groups:
            if sides[group[0]] == sides[index] and _equal(pieces[group[0]], pieces[index]):
                group.append(index)
                break
        else:
            groups.append([index])
    for group in groups:
        axis = placement(pieces[group[0]].primitive)[:3]
        frame = np.vstack([*tangent_frame(axis), axis])
        places = np.array([frame[:2] @ placement(pieces[k].primitive)[3:6] for k in group])
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        leads = [k for k in range(len(group)) if not (apart[k, :k] < _SAME).any()]
        spreads = np.array([spread[group[k]] for k in leads])
        yield Sites([group[k] for k in leads], frame, places[leads], spreads, pieces[group[0]].primitive.kind)


def _equal(a: Piece, b: Piece) -> bool:
    """Whether one is the other, shifted across their parallel axes."""
    p, q = a.primitive, b.primitive
    if isinstance(p, Cylinder) and isinstance(q, Cylinder):
        return abs(p.radius - q.radius) < _SAME and bool(np.linalg.norm(np.cross(p.axis, q.axis)) < _SAME)
    if not isinstance(p, Cone) or not isinstance(q, Cone) or np.linalg.norm(p.axis - q.axis) > _SAME:
        return False
    angle, height = p.half_angle - q.half_angle, float((p.apex - q.apex) @ p.axis)
    slack = tolerances(np.hypot(_cone_spread(a, p), _cone_spread(b, q)))
    return bool(abs(angle) < slack[0] and abs(height) < slack[1])


def _cone_spread(entry: Piece, cone: Cone) -> Array:
    """Standard deviations of half angle and apex height (2,)."""
    rows = np.vstack([np.eye(6)[5], cone.axis @ cone.apex_jacobian()])
    return np.sqrt(np.einsum("ij,jk,ik->i", rows, entry.covariance, rows))


def _axes(pieces: Pieces, sites: Sites) -> list[tuple[int, Array, float]]:
    """Index, place (2,) and spread of every other parallel axis, each place once."""
    axes: list[tuple[int, Array, float]] = []
    for index in sorted(pieces, key=lambda k: k in sites.indices):
        entry = pieces[index]
        if entry.primitive.kind not in ("cylinder", "cone", "torus") or not is_known(entry.lateral):
            continue
        numbers = placement(entry.primitive)
        place = sites.frame[:2] @ numbers[3:6]
        if np.linalg.norm(np.cross(numbers[:3], sites.frame[2])) < _SAME:
            if all(np.linalg.norm(place - other) > _SAME for _, other, _ in axes):
                axes.append((index, place, entry.lateral))
    return axes


def _bolt_circle(
    pieces: Pieces, sites: Sites, found: Lattice, first: int, axes: list[tuple[int, Array, float]]
) -> Pattern:
    """Every hole is the first one turned about the centre; an axis that is there already is the centre."""
    holes = [sites.indices[k] for k in found.members]
    centre = found.origin @ sites.frame[:2]
    circle = Cylinder(sites.frame[2], centre, float(np.linalg.norm(found.pitch)))
    angles = 2 * np.pi / found.turns * (found.steps[:, 0] - found.steps[0, 0])
    images = [
        Relation("bolt_circle", (holes[0], hole, first), TURNED[sites.kind], float(angle), _STRAIN)
        for hole, angle in zip(holes[1:], angles[1:])
    ]
    others = [Relation("bolt_circle", (first, holes[0]), on_circle, strain=_STRAIN)]
    spread = float(np.sqrt((sites.spread**2).mean() / len(holes)))
    for index, place, sigma in axes:
        if np.linalg.norm(place - found.origin) < tolerances(np.hypot(sigma, spread)):
            others.append(Relation("centred", (index, first), EQUATIONS["coaxial"], strain=_STRAIN))
            break
    held = {first: datum(circle, "pitch_radius", holes)}
    return Pattern("bolt_circle", tuple(images), tuple(others), held, f"every {360 / found.turns:g} degrees")


def _grid(
    pieces: Pieces, sites: Sites, found: Lattice, first: int, axes: list[tuple[int, Array, float]]
) -> Pattern:
    """Every hole is another one shifted along a row or a column; these are square to each other."""
    holes, pitches = [sites.indices[k] for k in found.members], found.pitch @ sites.frame[:2]
    datums, others = {}, []
    reach = np.linalg.norm(np.ptp(found.steps, axis=0) @ found.pitch)
    for number, pitch in enumerate(pitches):
        length = float(np.linalg.norm(pitch))
        datums[first + number] = datum(Cylinder(pitch / length, np.zeros(3), length), "pitch", holes, placed=False)
        others.append(Relation("square", (holes[0], first + number), EQUATIONS["perpendicular"], strain=_STRAIN))
        limit = float(min(3 * sites.spread.max() / reach + 1e-3, _ROW_ANGLE))
        others += _aligned(pieces, pitch / length, sites.frame[2], first + number, limit)
    if len(pitches) == 2:
        others.append(Relation("square", (first, first + 1), EQUATIONS["perpendicular"], strain=_STRAIN))
    kind = ("linear_pattern", "grid_pattern")[len(pitches) - 1]
    images = [
        Relation(kind, (holes[a], holes[b], first + along), SHIFTED[sites.kind], float(times), _STRAIN)
        for a, b, along, times in _links(found)
    ]
    return Pattern(kind, tuple(images), tuple(others), datums)


def _links(found: Lattice) -> Iterator[tuple[int, int, int, int]]:
    """A tree over the members: from, to, along which pitch, how many times. What it cannot reach is left out."""
    reached = [0]
    waiting = list(range(1, len(found.steps)))
    while waiting:
        for k, seen in ((k, seen) for k in waiting for seen in reached):
            change = found.steps[k] - found.steps[seen]
            if np.count_nonzero(change) == 1:
                along = int(np.flatnonzero(change)[0])
                yield seen, k, along, int(change[along])
                reached.append(k)
                waiting.remove(k)
                break
        else:
            return


def _aligned(pieces: Pieces, direction: Array, axis: Array, index: int, limit: float) -> list[Relation]:
    """The datum `index` across or along a plane, parallel to the axes, that it nearly is across or along."""
    for k, entry in pieces.items():
        normal = placement(entry.primitive)[:3]
        if entry.primitive.kind == "plane" and abs(normal @ axis) < _SAME:
            for kind, off in (("perpendicular", normal @ direction), ("parallel", normal @ np.cross(axis, direction))):
                if abs(off) < np.sin(limit):
                    return [Relation("aligned", (k, index), EQUATIONS[kind], strain=_STRAIN)]
    return []
