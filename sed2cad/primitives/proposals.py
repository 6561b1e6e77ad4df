"""Relations that fitted primitives seem to have: proposed where the uncertainty of the fits allows them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.oriented_fit import directions
from sed2cad.primitives.refine import Directions, centred, tukey_weights, uncertainty
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.relations import ALIKE, EQUATIONS, SAME, TANGENCIES, Equation, placement, residuals
from sed2cad.primitives.robust_fit import UNSEEN, thinned
from sed2cad.primitives.solve_relations import Evidence, Relation, Turns
from sed2cad.primitives.vectors import tangent_frame

# Most that a primitive is changed by, whatever its uncertainty.
_ANGLE = np.radians(9.0)
_WEAK_ANGLE = np.radians(30.0)  # most for a direction that is known well the other way
_ELLIPSE = 3.44  # deviations of two numbers that chance exceeds as seldom as three of one
_SQUARE = np.radians(3.0)  # most for perpendicular, which many directions are by chance
_SHIFT = 0.012  # of an axis, unit frame
_OFFSET = 0.002  # of a plane, unit frame
_RADIUS_CHANGE = 0.002  # unit frame
_RADIUS_SHARE = 0.05  # radii that differ more are two radii
_TANGENT_MISFIT = 0.08  # of a tangency's equations, radians or unit frame

_INDEPENDENT = 50  # points of a patch that err independently where neighbours err together
_MOST_POINTS = 300  # per primitive, to weigh it against the relations
_SAME_MISFIT = 0.006  # of two patches of one surface, radians or unit frame
_WORSENING = 0.25  # growth of chi^2 per point that intent outweighs
_CHANCE = 4.0  # growth of chi^2 per parameter that chance explains
_SIGNS = (1.0, -1.0)  # of an equation
_LEAST_SIGMA = 1e-4  # unit frame; no points are trusted more

DIRECTION = slice(0, 2)  # in every chart but the sphere's
_LATERAL = {"cylinder": slice(2, 4), "cone": slice(2, 4), "torus": slice(2, 5), "sphere": slice(0, 3)}
_RADIUS = {"cylinder": slice(4, 5), "sphere": slice(3, 4), "torus": slice(6, 7)}


@dataclass(frozen=True)
class Piece:
    """A primitive with what its points say about it."""

    primitive: Primitive
    evidence: Evidence
    covariance: Array  # (freedom, freedom), systematic errors allowed for

    def spread(self, part: slice, known: slice = slice(0, 0)) -> float:
        """Largest standard deviation within a part of the chart; another part may be known already."""
        covariance = self.covariance[part, part]
        if known.stop:
            mixed = self.covariance[part, known]
            covariance = covariance - mixed @ np.linalg.pinv(self.covariance[known, known]) @ mixed.T
        return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))

    def spoiled_by(self, moved: Primitive) -> bool:
        """Whether a changed primitive has left the points by more than chance and anyone's eye allow."""
        before, after = self.evidence.chi_square(self.primitive), self.evidence.chi_square(moved)
        count, sigma = len(self.evidence.points), float(1 / np.sqrt(self.evidence.weights.max()))
        unseen = count * (UNSEEN / sigma) ** 2
        return after - before > max(_WORSENING * count, _CHANCE * moved.freedom, unseen)

    @property
    def lateral(self) -> float:
        """Standard deviation of the place of the axis or centre, its direction being known."""
        known = slice(0, 0) if self.primitive.kind == "sphere" else DIRECTION
        return self.spread(_LATERAL[self.primitive.kind], known)

    @property
    def offset(self) -> float:
        """Standard deviation of a plane's offset, its direction being known."""
        return self.spread(slice(2, 3), DIRECTION)


Pieces = dict[int, Piece]


def piece(
    primitive: Primitive, points: Array, normals: Array, noise: float, angle: float, likeness: float = 1.0
) -> Piece:
    """Weigh a primitive by its points (n, 3) and their normals (n, 3), which deviate by `angle`, radians.

    Few of them are no better than the noise of the whole scan. `likeness` is the correlation of the errors of
    neighbours: as far as they err together many say no more than _INDEPENDENT do. And whatever they say, all of them
    may be off by what nobody sees, which is three deviations. Of more than _MOST_POINTS some stand for all, and say
    what all do: that the primitive is right.
    """
    primitive, count = centred(primitive, points), len(points)
    points, normals = thinned(points, normals, _MOST_POINTS)
    said = directions(primitive, points, normals, noise, angle)
    fit = uncertainty(primitive, points, noise, said)
    sigma = max(fit.sigma, _LEAST_SIGMA, noise if len(points) < _INDEPENDENT else 0.0)
    weights = tukey_weights(primitive.distance(points), noise, primitive.freedom) / sigma**2
    if count > len(points):
        points = primitive.project(points)
        said = said and replace(said, normals=primitive.normal(points))
    evidence = Evidence(points, weights, None if said is None else _turns(primitive, points, said))
    together = (1 + likeness * max(0.0, count / _INDEPENDENT - 1)) * len(points) / count
    systematic = len(points) * (UNSEEN / 3) ** 2
    return Piece(primitive, evidence, fit.covariance * (sigma**2 * together + systematic) / fit.sigma**2)


def _turns(primitive: Primitive, points: Array, said: Directions) -> Turns:
    """The directions as evidence."""
    terms = said.terms(primitive, points)
    return Turns(said.normals, terms.trust / said.noise**2, terms.whitening)


def propose_directions(pieces: Pieces) -> list[Relation]:
    """Each direction parallel to a better known one, or else perhaps perpendicular to the other groups'."""
    spread = {k: p.spread(DIRECTION) for k, p in pieces.items() if p.primitive.kind != "sphere"}
    leaders: list[int] = []
    relations: list[Relation] = []
    for index in sorted(spread, key=lambda k: spread[k]):
        strain = np.array([_turn(pieces[index], pieces[leader], spread[leader]) for leader in leaders])
        if leaders and strain.min() < 1:
            best = int(np.argmin(strain))
            relations.append(_relation("parallel", leaders[best], index, strain[best]))
            continue
        for leader in leaders:
            angle = _angle(pieces[index].primitive, pieces[leader].primitive)
            limit = _tolerance(spread[index], spread[leader], _SQUARE)
            if np.pi / 2 - angle < limit:
                relations.append(_relation("perpendicular", leader, index, (np.pi / 2 - angle) / limit))
        leaders.append(index)
    return relations


def _turn(piece: Piece, leader: Piece, spread: float) -> float:
    """The turn from one direction to another in units of what is tolerated: an ellipse of deviations.

    An axis may be known well one way and badly the other, as that of a narrow strip of a cone.
    """
    own, other = (placement(entry.primitive)[:3] for entry in (piece, leader))
    frame = np.column_stack(tangent_frame(own))
    values, vectors = np.linalg.eigh(piece.covariance[DIRECTION, DIRECTION])
    deviations = _ELLIPSE * np.sqrt(np.maximum(values, 0) + spread**2)
    most = [_ANGLE, _ANGLE if deviations[0] > _ANGLE else _WEAK_ANGLE]
    limits = np.minimum(deviations, most)
    turn = frame.T @ other if own @ other >= 0 else -frame.T @ other
    if abs(own @ other) < np.cos(_WEAK_ANGLE):
        return float("inf")
    return float(np.linalg.norm((vectors.T @ turn) / np.sin(limits)))


def propose_coplanar(pieces: Pieces, directions: Iterable[Relation]) -> list[Relation]:
    """Parallel planes with nearly one offset; the directions must hold already."""
    relations = []

    def strain(leader: int, index: int) -> float:
        p, q = placement(pieces[leader].primitive), placement(pieces[index].primitive)
        gap = abs(p[6] - np.sign(p[:3] @ q[:3]) * q[6])
        return gap / _tolerance(pieces[leader].offset, pieces[index].offset, _OFFSET)

    for group in _groups(pieces, directions):
        planes = sorted(_of_kind(pieces, group, ("plane",)), key=lambda k: pieces[k].offset)
        for leader, index, size in _matches(planes, strain):
            p, q = placement(pieces[leader].primitive), placement(pieces[index].primitive)
            relations.append(_relation("coplanar", leader, index, size, float(np.sign(p[:3] @ q[:3]))))
    return relations


def propose_coaxial(pieces: Pieces, directions: Iterable[Relation], hosts: Mapping[int, int]) -> list[Relation]:
    """Parallel axes that nearly coincide, and spheres on them; the directions must hold already.

    What has adopted an axis goes where its host goes.
    """
    relations = []
    spheres = _of_kind(pieces, pieces, ("sphere",))

    def strain(leader: int, index: int) -> float:
        known = pieces[hosts.get(index, index)]
        p, q = placement(pieces[leader].primitive), placement(known.primitive)
        gap = float(np.linalg.norm(np.cross(q[3:6] - p[3:6], p[:3])))
        return gap / _tolerance(pieces[leader].lateral, known.lateral, _SHIFT)

    for group in _groups(pieces, directions):
        axes = sorted(_of_kind(pieces, group, ("cylinder", "cone", "torus")), key=lambda k: pieces[k].lateral)
        for leader, index, size in _matches(axes, strain, spheres):
            relations.append(_relation("concentric" if index in spheres else "coaxial", leader, index, size))
    return relations


def propose_radii(pieces: Pieces) -> list[Relation]:
    """Cylinders, spheres and tubes of tori with nearly one radius."""
    round_ = _of_kind(pieces, pieces, tuple(_RADIUS))
    spread = {k: pieces[k].spread(_RADIUS[pieces[k].primitive.kind]) for k in round_}
    radius = {k: placement(pieces[k].primitive)[7 if pieces[k].primitive.kind == "torus" else 6] for k in spread}

    def strain(leader: int, index: int) -> float:
        most = min(_RADIUS_CHANGE, _RADIUS_SHARE * radius[leader])
        limit = _tolerance(spread[leader], spread[index], most)
        return float(abs(radius[leader] - radius[index]) / limit)

    matches = _matches(sorted(spread, key=lambda k: spread[k]), strain)
    return [_equal_radius(pieces, leader, index, size) for leader, index, size in matches]


def _matches(
    ordered: Sequence[int], strain: Callable[[int, int], float], followers: Sequence[int] = ()
) -> list[tuple[int, int, float]]:
    """(leader, index, strain): each with the leader it strains least from, if by less than 1; else it leads itself.

    The best known come first; followers never lead.
    """
    leaders: list[int] = []
    found = []
    for index in [*ordered, *followers]:
        strains = [strain(leader, index) for leader in leaders]
        best = int(np.argmin(strains)) if leaders else -1
        if leaders and strains[best] < 1:
            found.append((leaders[best], index, strains[best]))
        elif index not in followers:
            leaders.append(index)
    return found


def _equal_radius(pieces: Pieces, a: int, b: int, strain: float) -> Relation:
    a, b = sorted((a, b), key=lambda k: pieces[k].primitive.kind == "torus")
    tori = sum(pieces[k].primitive.kind == "torus" for k in (a, b))
    equation = EQUATIONS[("equal_radius", "equal_minor", "equal_minors")[tori]]
    return Relation("equal_radius", (a, b), equation, strain=strain)


def propose_tangencies(pieces: Pieces, pairs: Iterable[tuple[int, int]], sides: Sequence[int]) -> list[Relation]:
    """For each pair that touches smoothly: the way of being one surface or tangent that nearly holds.

    `sides` are 1 where a primitive's own normals point outwards, else -1: what touches smoothly agrees on outwards.
    """
    relations = []
    for pair in pairs:
        if not all(index in pieces for index in pair):
            continue
        a, b = sorted(pair, key=lambda k: ANALYTIC_KINDS.index(pieces[k].primitive.kind))
        kinds = pieces[a].primitive.kind, pieces[b].primitive.kind
        same = [(SAME[kinds[0]], sign) for sign in _SIGNS] if kinds[0] == kinds[1] else []
        misfit, way, sign = _nearest(pieces[a].primitive, pieces[b].primitive, same)
        if misfit < _SAME_MISFIT:
            relations.append(Relation("same", (a, b), way, sign, misfit / _SAME_MISFIT))
            continue
        ways = ways_to_touch(TANGENCIES.get(kinds, ()), sides[a] * sides[b])
        misfit, way, sign = _nearest(pieces[a].primitive, pieces[b].primitive, ways)
        if misfit < _TANGENT_MISFIT:
            relations.append(Relation("tangent", (a, b), way, sign, misfit / _TANGENT_MISFIT))
    return relations


def ways_to_touch(equations: Iterable[Equation], sense: int) -> list[tuple[Equation, float]]:
    """The equations and signs under which the primitives' own normals agree (sense 1) or oppose where they touch.

    A torus whose radius is known worse than its tube's lies as well within the cylinder as about it: only this tells.
    """
    signs = [(way, sign) for way in equations for sign in _SIGNS]
    return [(way, sign) for way, sign in signs if (sense > 0 if way in ALIKE else sign == -sense)]


def _nearest(a: Primitive, b: Primitive, ways: Sequence[tuple[Equation, float]]) -> tuple[float, Equation, float]:
    """The smallest of the largest residuals, its equation and its sign."""
    p, q = placement(a)[None], placement(b)[None]
    best: tuple[float, Equation, float] = (np.inf, EQUATIONS["parallel"], 1.0)
    for way, sign in ways:
        misfit = float(np.abs(residuals(way, p, q, np.array([sign]))).max())
        best = min(best, (misfit, way, sign), key=lambda entry: entry[0])
    return best


def _relation(kind: str, a: int, b: int, strain: float, sign: float = 1.0) -> Relation:
    return Relation(kind, (a, b), EQUATIONS[kind], sign, strain)


def _groups(pieces: Pieces, directions: Iterable[Relation]) -> list[list[int]]:
    """Indices with one direction, the best known first."""
    groups = {index: [index] for index, entry in pieces.items() if entry.primitive.kind != "sphere"}
    for relation in directions:
        if relation.kind == "parallel":
            a, b = relation.members
            groups[a].append(b)
            groups.pop(b)
    return list(groups.values())


def _of_kind(pieces: Pieces, indices: Iterable[int], kinds: tuple[str, ...]) -> list[int]:
    return [index for index in indices if pieces[index].primitive.kind in kinds]


def _tolerance(a: float, b: float, most: float) -> float:
    """Three standard deviations of a difference, at most so much."""
    return min(3 * float(np.hypot(a, b)), most)


def _angle(a: Primitive, b: Primitive) -> float:
    """Between two undirected directions, radians."""
    cross = np.cross(placement(a)[:3], placement(b)[:3])
    return float(np.arcsin(np.minimum(np.linalg.norm(cross), 1.0)))
