"""From points in a plane to the curve along them: their order, and a spline with knots where they ask for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array
from sed2cad.primitives.profile import DEGREE, Profile
from sed2cad.primitives.refine import usual_size
from sed2cad.primitives.vectors import unit

_CELLS = 60  # cells along the extent of the points that are ordered
_MOST_NODES = 1200  # more fill an area
_SECTORS = 8  # of normals: what faces elsewhere is another cell, even at the same place
_REACH = 2.6  # cells: neighbours
_FOLD = 0.2  # cosine between the normals of neighbours
_SIDEWAYS = 0.1  # weight of the distance along the curve against that across
_SMOOTHING = 1e-7  # weight of second differences of the controls against the mean weight of a control
MOST_SPANS = 96
_LEAST_POINTS = 3  # of a span that is cut in two, in each half
_BINS = 4  # of a span, whose mean residuals tell whether it is stiff
_OUTLYING = 4.0  # standard deviations that a residual counts for at most
_SURPRISE = 3.0  # standard deviations of chi^2 that noise does not reach


@dataclass(frozen=True)
class Course:
    """Where points are along the curve that they are on."""

    along: Array  # (n,), lengths, from 0
    length: float  # of the curve; the period where it is closed
    closed: bool


def course(flat: Array, arrows: Array, noise: float) -> Course | None:
    """The order of points (n, 2) with unit normals (n, 2) along one curve, or None where they are on none.

    Neighbours lie apart by the component of their offset along the tangent; the lengths along the curve are what
    agrees best with all of these (least squares on the graph of neighbours). On a closed curve a round of them
    misses its beginning by the period.
    """
    nodes, normals, cell = _nodes(flat, arrows, noise)
    if not 4 <= len(nodes) <= _MOST_NODES:
        return None
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    pairs, tree = _neighbours(nodes, normals, cell)
    a, b = pairs.T
    steps = 0.5 * np.einsum("ij,ij->i", tangents[a] + tangents[b], nodes[b] - nodes[a])
    rough = _walked(len(nodes), pairs, steps, tree)
    miss = rough[b] - rough[a] - steps
    extent = float(np.ptp(rough))
    around = np.abs(miss) > 0.6 * extent
    closed = bool(around.any())
    period = float(np.median(np.abs(miss[around]))) if closed else extent
    rounds = np.rint(miss / period) if closed else np.zeros(len(pairs))
    places, period = _settled(len(nodes), pairs, steps, rounds, period)
    _, nearest = cKDTree(np.hstack([nodes, 4 * cell * normals])).query(np.hstack([flat, 4 * cell * arrows]))
    along = places[nearest] + np.einsum("ij,ij->i", tangents[nearest], flat - nodes[nearest])
    if closed:
        return Course(np.mod(along, period), period, True)
    along -= along.min()
    return Course(along, float(along.max()), False)


def _nodes(flat: Array, arrows: Array, noise: float) -> tuple[Array, Array, float]:
    """Means of points and normals by cell, both (m, 2), and the size of a cell."""
    low = flat.min(axis=0)
    size = float(np.linalg.norm(flat.max(axis=0) - low))
    cell = max(size / _CELLS, 2 * noise, 1e-12)
    sector = np.floor((np.arctan2(arrows[:, 1], arrows[:, 0]) / (2 * np.pi) + 0.5) * _SECTORS) % _SECTORS
    keys = np.column_stack([np.floor((flat - low) / cell), sector]).astype(np.int64)
    _, owner, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    owner = owner.ravel()
    sums = [np.column_stack([np.bincount(owner, v[:, k]) for k in range(2)]) for v in (flat, arrows)]
    return sums[0] / count[:, None], unit(sums[1].astype(np.float64)), cell


def _neighbours(nodes: Array, normals: Array, cell: float) -> tuple[NDArray[np.int64], coo_array]:
    """Pairs (e, 2) of near nodes that face the same way, with a spanning tree over all gaps; and that tree."""
    offset = nodes[:, None] - nodes[None]
    distance = np.sqrt(np.einsum("ijk,ijk->ij", offset, offset))
    cosine = normals @ normals.T
    cost = (distance + 0.1 * cell) * (2 - cosine) ** 2
    tree = coo_array(minimum_spanning_tree(cost))
    near = np.triu((distance < _REACH * cell) & (cosine > _FOLD), 1)
    near[np.minimum(tree.row, tree.col), np.maximum(tree.row, tree.col)] = True
    return np.argwhere(near), tree


def _walked(count: int, pairs: NDArray[np.int64], steps: Array, tree: coo_array) -> Array:
    """Lengths (count,) along the spanning tree from its middle outwards."""
    step = np.zeros((count, count))
    step[pairs[:, 0], pairs[:, 1]], step[pairs[:, 1], pairs[:, 0]] = steps, -steps
    order, before = breadth_first_order(tree, 0, directed=False)
    rough = np.zeros(count)
    for node in order[1:]:
        rough[node] = rough[before[node]] + step[before[node], node]
    return rough


def _settled(
    count: int, pairs: NDArray[np.int64], steps: Array, rounds: Array, period: float
) -> tuple[Array, float]:
    """Least squares lengths (count,) from the steps between pairs, and the period."""
    rows, ones = np.arange(len(pairs)), np.ones(len(pairs))
    row, column = np.concatenate([rows, rows, rows]), np.append(pairs.T.ravel(), np.full(len(pairs), count))
    system = csr_array((np.concatenate([-ones, ones, -rounds]), (row, column)), shape=(len(pairs), count + 1))
    small = np.full(count + 1, 1e-9)
    small[0] = 1.0  # the first node is at 0
    solution = spsolve((system.T @ system + diags_array(small)).tocsc(), system.T @ steps)
    return solution[:count], float(solution[count]) if rounds.any() else period


@dataclass(frozen=True)
class Bent:
    """A profile fitted together with changes of the pose it is seen from."""

    profile: Profile
    delta: Array  # (k,): the changes
    covariance: Array  # (k, k) of these, the profile being unknown; in units of the variance of the distances


@dataclass(frozen=True)
class Sight:
    """Points as they are seen in one pose."""

    flat: Array  # (n, 2)
    arrows: Array  # (n, 2): their normals, unit
    slopes: Array  # (n, k): derivatives of their distances from the curve by changes of the pose
    weights: Array  # (n,)


def bent(profile: Profile, along: Array, across: Array, sight: Sight, trust: float) -> Bent:
    """The profile on the same knots nearest to points at parameters `along` (n,), by weighted least squares.

    Distances count along unit vectors `across` (n, 2) the curve, and a little along it. So do the angles between
    curve and normals, where `trust` is the distance that a radian is worth. Smoothing ties what the points leave open.
    LinAlgError where they determine nothing.
    """
    basis = _basis(profile, along)
    count, changes = basis.shape[1], sight.slopes.shape[1]
    ways = np.column_stack([-across[:, 1], across[:, 0]])
    nothing = np.zeros((len(along), changes))
    rows = [  # basis, direction, weight, changes, right-hand side
        (basis, across, 1.0, -sight.slopes, np.einsum("ij,ij->i", across, sight.flat)),
        (basis, ways, _SIDEWAYS, nothing, np.einsum("ij,ij->i", ways, sight.flat)),
        (_basis(profile, along, 1), sight.arrows, trust, nothing, np.zeros(len(along))),
    ]
    size = 2 * count + changes
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for values, way, factor, change, target in rows:
        weight = factor * np.sqrt(sight.weights)[:, None]
        system = weight * np.hstack([values * way[:, :1], values * way[:, 1:], change])
        matrix += system.T @ system
        right += system.T @ (weight[:, 0] * target)
    mean = float(np.trace(matrix[: 2 * count, : 2 * count])) / (2 * count)
    rough = mean * (_SMOOTHING * _roughness(profile, count) + 1e-12 * np.eye(count))
    matrix[: 2 * count, : 2 * count] += np.kron(np.eye(2), rough)
    diagonal = np.diag(matrix)
    scale = 1 / np.sqrt(np.maximum(diagonal, max(1e-20 * float(diagonal.max()), 1e-300)))
    inverse = np.linalg.inv(matrix * scale[:, None] * scale + 1e-13 * np.eye(size)) * scale[:, None] * scale
    solution = inverse @ right
    if not np.isfinite(solution).all():
        raise np.linalg.LinAlgError("the points determine no profile")
    order = np.arange(count + (DEGREE if profile.closed else 0)) % count
    controls = solution[: 2 * count].reshape(2, count).T[order]
    extra = slice(2 * count, None)
    return Bent(Profile(profile.knots, controls, profile.closed), solution[extra], inverse[extra, extra])


def _basis(profile: Profile, along: Array, derivative: int = 0) -> Array:
    """Values (n, controls) of the basis; those that repeat are added up."""
    every = np.eye(len(profile.knots) - DEGREE - 1)
    full = BSpline(profile.knots, every, DEGREE)(profile.wrapped(along), nu=derivative)
    if not profile.closed:
        return np.asarray(full)
    count = full.shape[1] - DEGREE
    folded = full[:, :count].copy()
    folded[:, :DEGREE] += full[:, count:]
    return folded


def _roughness(profile: Profile, count: int) -> Array:
    """Sum of squared second differences of the controls, as a matrix (count, count)."""
    eye = np.eye(count)
    second = np.roll(eye, 1, axis=0) - 2 * eye + np.roll(eye, -1, axis=0)
    second = second if profile.closed else second[1:-1]
    return np.asarray(second.T @ second)


def blank(course: Course, spans: int) -> Profile:
    """Even knots along a course, with nothing fitted yet; a closed one takes as many spans as its degree, at least."""
    if course.closed:
        spans = max(spans, DEGREE)
        knots = course.length / spans * np.arange(-DEGREE, spans + DEGREE + 1)
    else:
        inner = np.linspace(0, course.length, spans + 1)
        knots = np.concatenate([[0.0] * DEGREE, inner, [course.length] * DEGREE])
    return Profile(np.asarray(knots, float), np.zeros((len(knots) - DEGREE - 1, 2)), course.closed)


def stiff_spans(profile: Profile, along: Array, residual: Array, sigma: float) -> NDArray[np.bool_]:
    """Which spans of the profile (s,) leave residuals (n,) that are no noise, and have points enough to be cut.

    The mean residual of each quarter of a span is compared with what noise makes of it (sigma, or what the residuals
    show where that is more); single outliers hardly count.
    """
    borders = np.unique(profile.knots[DEGREE:-DEGREE])
    spans = len(borders) - 1
    at = profile.wrapped(along)
    span = np.clip(np.searchsorted(borders, at, side="right") - 1, 0, spans - 1)
    share = (at - borders[span]) / (borders[span + 1] - borders[span])
    cell = span * _BINS + np.clip((share * _BINS).astype(np.int64), 0, _BINS - 1)
    count = np.bincount(cell, minlength=spans * _BINS)
    usual = max(sigma, usual_size(residual))
    residual = np.clip(residual, -_OUTLYING * usual, _OUTLYING * usual)
    mean = np.bincount(cell, residual, minlength=spans * _BINS) / np.maximum(count, 1)
    scale = max(sigma, usual_size(residual - mean[cell]))
    surprise = (count * (mean / scale) ** 2).reshape(spans, _BINS).sum(axis=1)
    halves = count.reshape(spans, 2, _BINS // 2).sum(axis=2).min(axis=1)
    return np.asarray((surprise > _BINS + _SURPRISE * np.sqrt(2 * _BINS)) & (halves >= _LEAST_POINTS))


def cut(profile: Profile, spans: NDArray[np.bool_]) -> Profile:
    """The same curve with a knot more in the middle of the spans (s,) told; its controls are to be fitted again."""
    borders = np.unique(profile.knots[DEGREE:-DEGREE])
    middles = 0.5 * (borders[1:] + borders[:-1])[spans]
    inner = np.sort(np.concatenate([borders, middles]))
    if profile.closed:
        length = inner[-1] - inner[0]
        knots = np.concatenate([inner[-DEGREE - 1 : -1] - length, inner, inner[1 : DEGREE + 1] + length])
    else:
        knots = np.concatenate([[inner[0]] * DEGREE, inner, [inner[-1]] * DEGREE])
    return Profile(np.asarray(knots, float), np.zeros((len(knots) - DEGREE - 1, 2)), profile.closed)
