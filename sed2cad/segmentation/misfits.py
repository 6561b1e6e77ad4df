"""Small faces that a few points show, most of them about the axis of a face beside them.

When all else is settled, points are left that no surface near them comes close to, and small patches of unlikely
kinds: a handful of points on a countersink may be on a sphere as well. Where the normals can be trusted, one point with
its normal tells the surface about a known axis; so little is asked that a few points do for the bore below a
countersink or the tip that a drill left, and fewer still for one of a size that was seen elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.components import linked
from sed2cad.primitives.base import Primitive, side_of
from sed2cad.primitives.coaxial import NUMBERS, axis_of, coaxial
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.oriented_fit import oriented_fit
from sed2cad.primitives.registry import primitive_class
from sed2cad.segmentation.choose import NUMBER, Choice
from sed2cad.segmentation.energy import COARSE, UNEXPLAINED, Tolerances, data_cost
from sed2cad.segmentation.level import Level
from sed2cad.segmentation.refine import State
from sed2cad.segmentation.strips import groups

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEAST = 2  # points of a face
SMALL = 40  # points of a patch whose kind is in doubt, and of misfits that lie together: more were seen before
MISFIT = 0.99  # of the cap
LINKED = 8.0  # spacings, two points' distance: between neighbours on a face that a handful of points show
BESIDE = 12  # nearest points that tell the faces beside
SEEN = 0.5  # of the price of a primitive: of one that has the size of another
NEARLY_ALL = 0.8  # of the points of a patch: another surface that explains so many takes its place
ROUNDS = 5
TURNED = 0.05  # radians between a cone and the cylinder or plane that it nearly is: a few points do not tell
FREE = ("plane", "cylinder")  # kinds that need no face beside them
SAMPLES = (6, 12)  # points of a neighbourhood that may be of one face


def with_misfits(level: Level, state: State, tolerances: Tolerances) -> State:
    """The state with more patches, at its end, wherever one lowers the energy; emptied ones keep their place.

    In a few rounds: what has been found makes its like cheaper.
    """
    tree = cKDTree(level.points)
    for _ in range(ROUNDS):
        finder = _Finder(level, tolerances, state, tree)
        found = sorted(finder.patches(), key=lambda patch: -patch.saved)
        labels, primitives = state.labels.copy(), list(state.primitives)
        taken = np.zeros(len(labels), bool)
        for patch in found:
            if not taken[patch.members].any():
                labels[patch.left] = UNEXPLAINED
                labels[patch.members] = len(primitives)
                primitives.append(patch.choice)
                taken[patch.members] = taken[patch.left] = True
        if not taken.any():
            break
        state = State(labels, tuple(primitives))
    return state


@dataclass(frozen=True)
class _Found:
    """A surface, the points that it takes, those of patches in whose place it comes that it leaves, and the energy that
    it saves."""

    choice: Choice
    members: Rows
    left: Rows
    saved: float


@dataclass(frozen=True)
class _Finder:
    level: Level
    tolerances: Tolerances
    state: State
    tree: cKDTree  # of the level's points

    def patches(self) -> Iterator[_Found]:
        """The best for some misfits that lie together, and about each axis."""
        for members in self._together():
            yield from self._best(self._free(members), members)
        for label, choice in enumerate(self.state.primitives):
            axis = axis_of(choice.primitive)
            if axis is not None and len(members := self._beside(label)) >= LEAST:
                yield from self._best(self._about(axis, members), members)

    @cached_property
    def sizes(self) -> Rows:
        """Points of each patch."""
        return np.bincount(self.state.labels + 1, minlength=len(self.state.primitives) + 1)[1:]

    @cached_property
    def misfit(self) -> Mask:
        """Points (n,) of no patch, or far off an analytic one; a freeform one may be poor."""
        return self._costs(max(self.tolerances.angle, COARSE)) >= MISFIT * self.tolerances.cap

    @cached_property
    def now(self) -> Array:
        """What each point (n,) costs."""
        return np.where(self.misfit, self.tolerances.cap, self._costs(self.tolerances.angle))

    @cached_property
    def doubtful(self) -> Rows:
        """Misfits, and points of small patches."""
        small = (self.sizes <= SMALL) & [not choice.primitive.freeform for choice in self.state.primitives]
        return np.flatnonzero(self.misfit | (small[self.state.labels] & (self.state.labels >= 0)))

    @cached_property
    def around(self) -> NDArray[np.int64]:
        """Labels (m, BESIDE) of the points around each doubtful one."""
        _, near = self.tree.query(self.level.points[self.doubtful], BESIDE)
        return np.asarray(self.state.labels[near])

    def _together(self) -> list[Rows]:
        """Misfits that lie together."""
        bad = np.flatnonzero(self.misfit)
        if len(bad) < LEAST:
            return []
        _, piece = linked(self.level.points[bad], LINKED * self.level.graph.spacing)
        return [bad[own] for own in groups(piece) if LEAST <= len(own) <= SMALL]

    def _beside(self, label: int) -> Rows:
        """Misfits beside a patch, and all points of the small ones beside it."""
        own = self.doubtful[(self.around == label).any(axis=1)]
        patches = np.setdiff1d(self.state.labels[own[~self.misfit[own]]], label)
        lone = own[self.misfit[own]]
        return np.union1d(lone, self.doubtful[np.isin(self.state.labels[self.doubtful], patches)])

    def _best(self, candidates: Iterator[tuple[Primitive, int]], members: Rows) -> list[_Found]:
        """The surface that saves most, if one saves anything."""
        rated = (self._rated(surface, numbers, members) for surface, numbers in candidates)
        best = max((found for found in rated if found is not None), key=lambda found: found.saved, default=None)
        return [] if best is None else [best]

    def _rated(self, surface: Primitive, numbers: int, members: Rows) -> _Found | None:
        """What a surface, so many numbers of which the points had to tell, saves."""
        sign = side_of(surface.normal(self.level.points[members]), self.level.normals[members])
        cost = self._cost(surface, sign, members, self.tolerances.angle)
        fits, lone = cost < 0.5 * self.tolerances.cap, self.misfit[members]
        taken, saved = fits & lone, 0.0
        replaced = []
        for label in np.unique(self.state.labels[members[fits & ~lone]]):
            own = (self.state.labels[members] == label) & ~lone
            if fits[own].sum() >= NEARLY_ALL * self.sizes[label]:
                replaced.append(self.state.primitives[label])
                taken |= own
                saved += self.tolerances.primitive + replaced[-1].price
        same = len(replaced) == 1 and replaced[0].primitive.kind == surface.kind
        news = (fits & lone).sum() >= LEAST or not same
        if taken.sum() < LEAST or not news:
            return None
        price = NUMBER * numbers * float(np.log((taken & fits).sum()))
        saved += float((self.now[members] - cost)[taken].sum()) - price - self._price(surface)
        choice = Choice(surface, sign, float(cost[taken & fits].sum()), price)
        return _Found(choice, members[taken & fits], members[taken & ~fits], saved) if saved > 0 else None

    def _free(self, members: Rows) -> Iterator[tuple[Primitive, int]]:
        """Surfaces through some points, and the numbers of each."""
        points, normals = self.level.points[members], self.level.normals[members]
        tree = cKDTree(points)
        near = [tree.query(points, size)[1] for size in SAMPLES if size < len(points)]
        samples = [row for index in near for row in np.unique(np.sort(index, axis=1), axis=0)]
        for sample in [np.arange(len(points)), *samples]:
            for kind in FREE:
                distance, angle = self.tolerances.distance, self.tolerances.angle
                found = oriented_fit(kind, None, points[sample], normals[sample], distance, angle)
                if found is not None:
                    yield found, primitive_class(kind).freedom

    def _about(self, axis: tuple[Array, Array], members: Rows) -> Iterator[tuple[Primitive, int]]:
        """Surfaces about an axis (direction, origin) through one point each, and the numbers that it tells."""
        for kind, numbers in NUMBERS.items():
            for one in members[:, None]:
                found = coaxial(kind, *axis, self.level.points[one], self.level.normals[one])
                if found is not None and not (isinstance(found, Cone) and np.sin(2 * found.half_angle) < TURNED):
                    yield found, numbers

    def _price(self, surface: Primitive) -> float:
        """Of one more primitive: less for a size that was seen before."""
        others = (choice.primitive for choice, size in zip(self.state.primitives, self.sizes) if size)
        return (SEEN if any(self._equal(surface, other) for other in others) else 1.0) * self.tolerances.primitive

    def _equal(self, a: Primitive, b: Primitive) -> bool:
        """Whether two surfaces have one size, as far as the tolerances tell."""
        match a, b:
            case (Cylinder(), Cylinder()):
                return abs(a.radius - b.radius) < self.tolerances.distance
            case (Cone(), Cone()):
                return abs(a.half_angle - b.half_angle) < self.tolerances.angle
        return False

    def _costs(self, angle: float) -> Array:
        """Data cost of all points (n,), none on freeform patches, for normals with this deviation."""
        cost = np.where(self.state.labels < 0, self.tolerances.cap, 0.0)
        for label, choice in enumerate(self.state.primitives):
            own = np.flatnonzero(self.state.labels == label)
            if not choice.primitive.freeform:
                cost[own] = self._cost(choice.primitive, choice.sign, own, angle)
        return cost

    def _cost(self, surface: Primitive, sign: int, own: Rows, angle: float) -> Array:
        tolerances = replace(self.tolerances, angle=angle)
        return data_cost(surface, sign, self.level.points[own], self.level.normals[own], tolerances)
