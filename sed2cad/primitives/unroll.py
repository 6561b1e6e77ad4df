"""Base parameters for points of one smooth sheet: along it and across it, in lengths.

The slowest function on the neighbour graph (Belkin and Niyogi 2003, Laplacian Eigenmaps) runs along the sheet however
it winds. Its directions, made unit vectors and turned by the normals, are integrated by least squares to lengths along
and across. Where the two slowest functions make a ring, the sheet closes along it; where lengths across do not fit
together, it closes across: a tube.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_lsq_spline
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import ArpackError, SuperLU, eigsh, splu
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.primitives.base import Array
from sed2cad.primitives.vectors import unit

MOST_POINTS = 5000  # that the graph is made of; the others take the parameters of their nearest
_NEIGHBOURS = (10, 16, 24)  # of a point, tried in turn until the sheet
_WHOLE = 0.99  # of it, to be precise, hangs together
_ALIKE = 0.5  # cosine between the normals of neighbours on one sheet
_STEEP = 0.35  # of the length of an edge between them: its height over the tangent planes
_RING = 0.5  # of its median radius: how near to its centre a ring comes
_TORN = 0.35  # rms mismatch of an edge, over its length, of a sheet that must be closed
_DRIFT = 0.8  # of the width of a strip: what is left of it when it is straight
_SLICE = 8.0  # deviations of the points across a strip: along it, its middle and width may change
_LONG = 30.0  # the same: a strip so long is straightened in any case
_NARROW = 0.4  # of the mean width, at least
_SMOOTHINGS = 12  # of directions, over their neighbours


@dataclass(frozen=True)
class Unrolled:
    """Parameters of points."""

    uv: Array  # (n, 2) lengths along u and v
    period: float  # of u; 0 where the sheet is open
    torn: float  # rms over the edges of what their parameters miss, over their lengths


def unrolled(points: Array, normals: Array) -> list[Unrolled]:
    """Ways to lay the sheet of points (n, 3) with unit normals (n, 3) flat, likely ones first; maybe none."""
    some = np.arange(len(points))[:: max(1, -(-len(points) // MOST_POINTS))]
    graph = None
    for neighbours in _NEIGHBOURS:
        wider = _Graph.of(points[some], normals[some], neighbours)
        graph = wider if graph is None or (wider and len(wider.points) > len(graph.points)) else graph
        if graph and len(graph.points) >= _WHOLE * len(some):
            break
    if graph is None:
        return []
    try:
        slow = graph.slowest(2)
    except (ArpackError, RuntimeError):
        return []
    found = [_ring(graph, slow)] if _is_ring(slow) else []
    if not found:
        found = [_strip(graph, slow[:, 0])]
        if found[0].torn > _TORN:
            found.insert(0, _tube(graph, slow[:, 0]))
    nearest = cKDTree(graph.points).query(points)[1]
    return [Unrolled(way.uv[nearest], way.period, way.torn) for way in found]


@dataclass(frozen=True)
class _Graph:
    """Points with their neighbours on the sheet."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3)
    near: NDArray[np.int64]  # (n, k)
    joined: NDArray[np.bool_]  # (n, k), whether that neighbour is on the sheet

    @classmethod
    def of(cls, points: Array, normals: Array, neighbours: int) -> _Graph | None:
        """The largest piece of the neighbour graph; None where there is hardly one."""
        if len(points) <= 2 * neighbours:
            return None
        distance, near = cKDTree(points).query(points, neighbours + 1)
        distance, near = distance[:, 1:], near[:, 1:].astype(np.int64)
        edge = points[near] - points[:, None]
        height = np.abs(np.einsum("ikj,ikj->ik", edge, normals[:, None] + normals[near])) / 2
        joined = (np.einsum("ij,ikj->ik", normals, normals[near]) > _ALIKE) & (height <= _STEEP * distance)
        i, k = np.nonzero(joined)
        piece = components(len(points), np.column_stack([i, near[i, k]]))[1]
        largest = piece == np.bincount(piece).argmax()
        if largest.sum() < max(len(points) // 2, 2 * neighbours):
            return None
        rank = np.cumsum(largest) - 1
        inside = joined[largest] & largest[near[largest]]
        return cls(points[largest], normals[largest], np.where(inside, rank[near[largest]], 0), inside)

    @cached_property
    def pairs(self) -> NDArray[np.int64]:
        """Edges (m, 2), each once."""
        i, k = np.nonzero(self.joined)
        pairs = np.sort(np.column_stack([i, self.near[i, k]]), axis=1)
        return np.unique(pairs, axis=0)

    @cached_property
    def edges(self) -> Array:
        """Vectors (m, 3) of the edges."""
        return self.points[self.pairs[:, 1]] - self.points[self.pairs[:, 0]]

    @cached_property
    def incidence(self) -> csr_array:
        """(m, n): differences along the edges."""
        count = len(self.pairs)
        rows, ends = np.repeat(np.arange(count), 2), np.tile([-1.0, 1.0], count)
        return csr_array((ends, (rows, self.pairs.ravel())), shape=(count, len(self.points)))

    @cached_property
    def solver(self) -> SuperLU:
        """Of the graph's Laplacian, tied down a little."""
        laplacian = self.incidence.T @ self.incidence
        return splu((laplacian + diags_array(np.full(len(self.points), 1e-9))).tocsc())

    def slowest(self, count: int) -> Array:
        """The slowest functions (n, count) on the graph but the constant, by their eigenvalues."""
        laplacian = (self.incidence.T @ self.incidence).tocsc()
        start = np.random.default_rng(0).normal(size=len(self.points))
        value, vector = eigsh(laplacian, count + 1, sigma=-1e-6, which="LM", v0=start)
        return np.asarray(vector[:, np.argsort(value)[1:]])

    def gradient(self, values: Array, period: float = 0.0) -> Array:
        """Tangent gradients (n, 3) of values (n,), by least squares over the neighbours; period 0 for none."""
        edge = (self.points[self.near] - self.points[:, None]) * self.joined[:, :, None]
        rise = values[self.near] - values[:, None]
        rise = rise if period == 0 else _wrapped(rise, period)
        matrix = np.einsum("ikj,ikl->ijl", edge, edge)
        size = np.trace(matrix, axis1=1, axis2=2)[:, None, None]
        matrix += size * (1e-6 * np.eye(3) + self.normals[:, :, None] * self.normals[:, None, :])
        rhs = np.einsum("ikj,ik->ij", edge, rise * self.joined)
        found = np.linalg.solve(matrix + 1e-300 * np.eye(3), rhs[:, :, None])[:, :, 0]
        return self.tangent(found)

    def tangent(self, vectors: Array) -> Array:
        """Vectors (n, 3) without their parts along the normals."""
        return vectors - np.einsum("ij,ij->i", vectors, self.normals)[:, None] * self.normals

    def directions(self, gradients: Array) -> Array:
        """Unit tangent vectors (n, 3) along gradients (n, 3), evened out: weak ones follow their neighbours."""
        field, weight = gradients, self.joined / np.maximum(self.joined.sum(axis=1), 1)[:, None]
        for _ in range(_SMOOTHINGS):
            field = self.tangent(field + np.einsum("ik,ikj->ij", weight, field[self.near]))
        return unit(field)

    def lengths(self, field: Array) -> tuple[Array, float]:
        """Values (n,) whose differences along the edges are those of the field (n, 3), and the rms mismatch."""
        i, j = self.pairs.T
        rise = np.einsum("ij,ij->i", self.edges, field[i] + field[j]) / 2
        values = self.solver.solve(self.incidence.T @ rise)
        return values - values.min(), self.mismatch(self.incidence @ values - rise)

    def mismatch(self, misses: Array) -> float:
        """Rms of misses (m,) of the edges over that of their lengths."""
        return float(np.sqrt(np.mean(misses**2) / np.mean(np.einsum("ij,ij->i", self.edges, self.edges))))


def _is_ring(slow: Array) -> bool:
    """Whether two functions (n, 2) go around a hole."""
    radius = np.linalg.norm(slow / np.maximum(slow.std(axis=0), 1e-300), axis=1)
    angle = np.sort(np.arctan2(slow[:, 1], slow[:, 0]))
    gap = np.diff(np.append(angle, angle[0] + 2 * np.pi)).max()
    return bool(np.quantile(radius, 0.01) > _RING * np.median(radius) and gap < 0.5)


def _strip(graph: _Graph, slow: Array) -> Unrolled:
    """Open in both directions."""
    along = graph.directions(graph.gradient(slow))
    u, torn_u = graph.lengths(along)
    v, torn_v = graph.lengths(np.cross(graph.normals, along))
    return Unrolled(np.column_stack([u, _straightened(u, v)]), 0.0, max(torn_u, torn_v))


def _straightened(u: Array, v: Array) -> Array:
    """The coordinates v (n,) across a strip without its sidewards drift, and in units of its width there.

    Left as they are where the strip is not narrower for it.
    """
    length, width = float(np.ptp(u)), float(v.std())
    for _ in range(2):
        spans = int(np.clip(length / (_SLICE * max(width, 1e-300)), 1, max(len(u) // 30, 1)))
        knots = np.quantile(u, np.linspace(0, 1, spans + 1))
        off = v - _smooth(u, v, knots)
        width = float(off.std())
    if width > _DRIFT * v.std() and length < _LONG * width:
        return v
    local = np.sqrt(np.maximum(_smooth(u, off**2, knots), 0.0))
    return np.asarray(off * width / np.maximum(local, _NARROW * width))


def _smooth(u: Array, values: Array, inner: Array) -> Array:
    """Values (n,) by the cubic spline in u (n,) that fits them best, with breaks `inner`."""
    order = np.argsort(u)
    knots = np.concatenate([inner[:1].repeat(3), inner, inner[-1:].repeat(3)])
    return np.asarray(make_lsq_spline(u[order], values[order], knots, k=3)(u))


def _ring(graph: _Graph, slow: Array) -> Unrolled:
    """Closed along the ring that two functions (n, 2) make."""
    scaled = slow / slow.std(axis=0)
    angle = np.arctan2(scaled[:, 1], scaled[:, 0])
    along = graph.directions(graph.gradient(angle, 2 * np.pi))
    i, j = graph.pairs.T
    rise = np.einsum("ij,ij->i", graph.edges, along[i] + along[j]) / 2
    turn = _wrapped(graph.incidence @ angle, 2 * np.pi) / (2 * np.pi)
    fitted = [turn - graph.incidence @ graph.solver.solve(graph.incidence.T @ turn)]  # harmonic part of the turns
    period = float(fitted[0] @ rise / (fitted[0] @ fitted[0]))
    offset = graph.solver.solve(graph.incidence.T @ (rise - period * turn))
    u = np.mod(period * angle / (2 * np.pi) + offset, period)
    miss = graph.mismatch(graph.incidence @ offset + period * turn - rise)
    v, torn = graph.lengths(np.cross(graph.normals, along))
    thrice = np.concatenate([u - period, u, u + period])
    v = np.split(_straightened(thrice, np.tile(v, 3)), 3)[1]
    return Unrolled(np.column_stack([u, v]), period, max(miss, torn))


def _tube(graph: _Graph, slow: Array) -> Unrolled:
    """Closed around a bent spine: angles about it, and lengths along it."""
    along = graph.directions(graph.gradient(slow))
    v, torn = graph.lengths(along)
    spine, frame = _spine(graph.points, v)
    at = np.clip(v, spine[0, 3], spine[-1, 3])
    centre = np.column_stack([np.interp(at, spine[:, 3], spine[:, k]) for k in range(3)])
    x, y = (np.column_stack([np.interp(at, spine[:, 3], frame[:, a, k]) for k in range(3)]) for a in range(2))
    offset = graph.points - centre
    angle = np.arctan2(np.einsum("ij,ij->i", offset, y), np.einsum("ij,ij->i", offset, x))
    around = float(np.hypot(np.einsum("ij,ij->i", offset, x), np.einsum("ij,ij->i", offset, y)).mean())
    period = 2 * np.pi * around
    return Unrolled(np.column_stack([np.mod(angle * around, period), v]), period, torn)


def _spine(points: Array, v: Array) -> tuple[Array, Array]:
    """Centres of the cross-sections with their place (m, 3 + 1) along v, and frames (m, 2, 3) that do not twist."""
    width = float(np.sqrt(np.mean(np.var(points, axis=0))))
    count = int(np.clip(len(points) / 40, 4, 200))
    edges = np.linspace(v.min(), v.max(), count + 1)
    bin_of = np.clip(np.searchsorted(edges, v, side="right") - 1, 0, count - 1)
    number = np.bincount(bin_of, minlength=count)
    rows = [np.bincount(bin_of, values, count) / np.maximum(number, 1) for values in (*points.T, v)]
    spine = np.column_stack(rows)[number > 5]
    tangent = unit(np.gradient(spine[:, :3], axis=0)) if len(spine) > 1 else np.tile([0.0, 0.0, width], (1, 1))
    x = unit(np.cross(tangent[0], np.eye(3)[np.abs(tangent[0]).argmin()]))
    frames = np.empty((len(spine), 2, 3))
    for k, t in enumerate(tangent):
        x = unit(x - (x @ t) * t)
        frames[k] = x, np.cross(t, x)
    return spine, frames


def _wrapped(values: Array, period: float) -> Array:
    """Brought into [-period / 2, period / 2)."""
    return np.mod(values + period / 2, period) - period / 2
