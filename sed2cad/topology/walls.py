"""Walls of steps and rims that the labels lost: two parallel faces share a border but lie at different heights there.

No edge can lie on both of them. A wall is put between: on the surface of a patch that runs along the border, else
on the plane or cylinder that stands on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.geometry.chains import length
from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.robust_fit import robust_fit
from sed2cad.primitives.vectors import root_mean_square, unit
from sed2cad.scan.scan import Array, Scan
from sed2cad.topology.model import Chain, Region, Topology

_LEVEL = 0.97  # cosine between the normals of the two faces, at least; opposite ones are those of a sheet
_STEP = 0.35  # spacings: lower steps are left to the tolerances
_UPRIGHT = 0.85  # cosine between the normals of a wall and of the surface that is to hold it, at least
_ALONG = 0.25  # of the height: a surface so near to the border runs along it
_NEAR = 3.0  # spacings between the border and a point of such a patch
_LOOSE = 0.8  # spacings: rms of the border from the wall that stands on it
_LONG = 2.0  # heights: a shorter border with no such patch is a flaw of the mesh, where a corner is
_ROWS = 5  # of points on a wall


@dataclass(frozen=True)
class Step:
    """A border between two heights."""

    chain: int
    closed: bool
    foot: Array  # (k, 3) on the left face
    head: Array  # (k, 3) on the right face
    outward: Array  # (k, 3) unit normals of the wall

    @property
    def height(self) -> float:
        return float(np.median(np.linalg.norm(self.head - self.foot, axis=1)))

    @property
    def length(self) -> float:
        return length(self.foot, self.closed)

    def rows(self) -> tuple[Array, Array]:
        """Points (m, 3) spread over the wall and their normals."""
        shares = np.linspace(0, 1, _ROWS)[:, None, None]
        points = ((1 - shares) * self.foot + shares * self.head).reshape(-1, 3)
        return points, np.tile(self.outward, (_ROWS, 1))


def walled(scan: Scan, topology: Topology, fitted: Sequence[FittedPatch]) -> tuple[Topology, list[FittedPatch]]:
    """The topology with a wall at every step, and the patches with those that had to be made for it."""
    patches = list(fitted)
    for number in range(len(topology.chains)):
        step = _step(scan, topology, patches, number)
        if step is None or not _is_simple(topology, number):
            continue
        wall = _running_along(scan, step, patches)
        if wall < 0:
            made = _standing_on(scan, step, patches)
            if made is None:
                continue
            wall = len(patches)
            patches.append(made)
        topology = _with_wall(topology, step, wall, patches)
    return topology, patches


def _step(scan: Scan, topology: Topology, patches: Sequence[FittedPatch], number: int) -> Step | None:
    """The step at a chain, where there is one."""
    chain = topology.chains[number]
    left, right = (patches[topology.regions[r].primitive] for r in (chain.left, chain.right))
    if left.primitive.freeform or right.primitive.freeform or len(chain.points) < 2:
        return None
    up, other = (patch.sign * patch.primitive.normal(chain.points) for patch in (left, right))
    low, high = (patch.sign * patch.primitive.distance(chain.points) for patch in (left, right))
    cosine = float(np.median(np.einsum("ij,ij->i", up, other)))
    rise = low - np.sign(cosine) * high  # of the right face above the left
    if abs(cosine) < _LEVEL or abs(np.median(rise)) < _STEP * scan.spacing:
        return None
    foot, head = (patch.primitive.project(chain.points) for patch in (left, right))
    around = np.vstack([chain.points[-1:], chain.points, chain.points[:1]])
    ahead = np.gradient(around, axis=0)[1:-1] if chain.closed else np.gradient(chain.points, axis=0)
    outward = unit(np.cross(ahead, up)) * -np.sign(np.median(rise))  # to the right, where the right face is lower
    return Step(number, chain.closed, foot, head, outward)


def _is_simple(topology: Topology, number: int) -> bool:
    """Whether a chain is closed, or the faces at each of its two corners are different ones."""
    chain = topology.chains[number]
    ends = () if chain.closed else (chain.start, chain.end)
    return chain.closed or (chain.start != chain.end and all(_fan(topology, number, corner)[0] for corner in ends))


def _fan(topology: Topology, number: int, corner: int) -> tuple[list[int], list[int]]:
    """The other chains at an end of a chain, from its right face around to its left one, and the faces between them.

    Empty where faces meet there more than once.
    """
    chain = topology.chains[number]
    here = [k for k, c in enumerate(topology.chains) for end in (c.start, c.end) if end == corner and k != number]
    face, order, faces = chain.right, [], []
    while face != chain.left:
        found = [k for k in here if face in (topology.chains[k].left, topology.chains[k].right) and k not in order]
        if len(found) != 1:
            return [], []
        order += found
        beside = topology.chains[found[0]]
        face = beside.right if beside.left == face else beside.left
        faces.append(face)
    simple = len(order) == len(here) and len(set(faces)) == len(faces) > 1
    return (order, faces[:-1]) if simple else ([], [])


def _running_along(scan: Scan, step: Step, patches: Sequence[FittedPatch]) -> int:
    """The patch whose surface holds the wall and that has points near it; -1: none."""
    points, normals = step.rows()
    found = []
    for number, patch in enumerate(patches):
        if patch.primitive.freeform or len(patch.patch.indices) == 0:
            continue
        off = float(np.median(np.abs(patch.primitive.distance(points))))
        cosine = patch.sign * np.einsum("ij,ij->i", patch.primitive.normal(points), normals)
        if off > _ALONG * step.height or np.median(cosine) < _UPRIGHT:
            continue
        away, _ = cKDTree(scan.points[patch.patch.indices]).query(points)
        if away.min() < _NEAR * scan.spacing:
            found.append((off, number))
    return min(found)[1] if found else -1


def _standing_on(scan: Scan, step: Step, patches: Sequence[FittedPatch]) -> FittedPatch | None:
    """A plane or cylinder through the border, across the faces: like a plane that is there, if that will do."""
    if step.length < _LONG * step.height:
        return None
    points, normals = step.rows()
    limit = _LOOSE * scan.spacing
    round_ = robust_fit("cylinder", points, normals, limit)
    surfaces = [*_like_others(points, normals, patches), _plane(points), *([round_[0]] if round_ else [])]
    for surface in surfaces:
        rms = root_mean_square(surface.distance(points))
        cosine = float(np.median(np.einsum("ij,ij->i", surface.normal(points), normals)))
        if rms > limit or abs(cosine) < _UPRIGHT:
            continue
        nothing = Patch(np.zeros(0, np.int64), surface.kind, np.zeros(0, bool))
        rms = max(rms, scan.noise)
        return FittedPatch(nothing, surface, 1 if cosine > 0 else -1, rms, rms**2 * np.eye(surface.freedom))
    return None


def _plane(points: Array) -> Primitive:
    """The plane through points (m, 3)."""
    centre = points.mean(axis=0)
    _, _, ways = np.linalg.svd(points - centre, full_matrices=False)
    return Plane(ways[2], float(ways[2] @ centre))


def _like_others(points: Array, normals: Array, patches: Sequence[FittedPatch]) -> list[Primitive]:
    """Through points (m, 3), parallel to the largest plane of the part that looks the way of the normals (m, 3)."""
    way = unit(normals.mean(axis=0))
    planes = [(len(patch.patch.indices), patch.primitive) for patch in patches if isinstance(patch.primitive, Plane)]
    alike = [(count, plane) for count, plane in planes if abs(plane.normal_vector @ way) > _UPRIGHT]
    if not alike:
        return []
    normal = max(alike, key=lambda entry: entry[0])[1].normal_vector
    return [Plane(normal, float(np.median(points @ normal)))]


def _with_wall(topology: Topology, step: Step, primitive: int, patches: Sequence[FittedPatch]) -> Topology:
    """The topology with a face between the two of a chain, whose border becomes two."""
    edit = _Edit(topology, step, primitive, patches)
    if topology.chains[step.chain].closed:
        edit.ring()
    else:
        edit.strip()
    return edit.topology()


class _Edit:
    """One wall being built. The chain stays with the left face; its double goes to the right one."""

    def __init__(self, topology: Topology, step: Step, primitive: int, patches: Sequence[FittedPatch]) -> None:
        self._old = topology
        self._step = step
        self._primitive = primitive
        self._patches = patches
        self.chains = list(topology.chains)
        self.loops = [[list(loop) for loop in region.loops] for region in topology.regions]
        self.corners = list(topology.corners)
        self.wall = len(topology.regions)

    def ring(self) -> None:
        """Around a closed border."""
        k, right = self._step.chain, self._old.chains[self._step.chain].right
        self.chains[k] = replace(self.chains[k], points=self._step.foot, right=self.wall)
        double = self._add(Chain(self._step.head, self.wall, right, -1, -1))
        self._renamed(right, k, double)
        self.loops.append([[(k, -1)], [(double, 1)]])

    def strip(self) -> None:
        """Along an open border: both corners become two, with an edge between."""
        k = self._step.chain
        old = self._old.chains[k]
        start, behind = self._torn(old.start, 0)
        end, ahead = self._torn(old.end, -1)
        self.chains[k] = replace(self.chains[k], points=self._step.foot, right=self.wall)
        double = self._add(Chain(self._step.head, self.wall, old.right, start, end))
        self._renamed(old.right, k, double)
        first = self._add(Chain(self._between(0), self.wall, behind, old.start, start))
        last = self._add(Chain(self._between(-1), ahead, self.wall, old.end, end))
        self._insert(behind, (first, -1), start, old.start)
        self._insert(ahead, (last, 1), old.end, end)
        self.loops.append([[(double, 1), (last, -1), (k, -1), (first, 1)]])

    def _torn(self, corner: int, at: int) -> tuple[int, int]:
        """A new corner at the head of the wall, with the chains that belong there; and the face between the two."""
        order, faces = _fan(self._old, self._step.chain, corner)
        foot, head = self._step.foot[at], self._step.head[at]
        self.corners[corner] = foot
        self.corners.append(head)
        new, away = len(self.corners) - 1, 1
        while away < len(faces) and self._off(order[away], head) < self._off(order[away], foot):
            away += 1
        for k in order[:away]:
            chain = self.chains[k]
            self.chains[k] = replace(chain, start=new) if chain.start == corner else replace(chain, end=new)
        return new, faces[away - 1]

    def _off(self, k: int, point: Array) -> float:
        """How far a point (3,) is off the surfaces of a chain; of points on both, the nearer is less off."""
        chain = self._old.chains[k]
        surfaces = [self._patches[self._old.regions[face].primitive].primitive for face in (chain.left, chain.right)]
        inner = chain.points[len(chain.points) // 2]
        return float(sum(abs(s.distance(point[None])[0]) for s in surfaces) + 0.05 * np.linalg.norm(point - inner))

    def _between(self, at: int) -> Array:
        """Points up an end of the wall."""
        return np.linspace(self._step.foot[at], self._step.head[at], 4)

    def _add(self, chain: Chain) -> int:
        self.chains.append(chain)
        return len(self.chains) - 1

    def _renamed(self, region: int, old: int, new: int) -> None:
        """A face goes along another chain."""
        for loop in self.loops[region]:
            loop[:] = [(new, way) if k == old else (k, way) for k, way in loop]

    def _insert(self, region: int, edge: tuple[int, int], start: int, end: int) -> None:
        """Put an edge of the wall into the loop of the face at its end, between the chains at two corners."""
        for loop in self.loops[region]:
            for at, (one, two) in enumerate(zip(loop, loop[1:] + loop[:1])):
                if self._end(one) == start and self._end((two[0], -two[1])) == end:
                    loop.insert(at + 1, edge)
                    return

    def _end(self, step: tuple[int, int]) -> int:
        """The corner at which a step arrives."""
        chain = self.chains[step[0]]
        return chain.end if step[1] > 0 else chain.start

    def topology(self) -> Topology:
        """The result."""
        points, _ = self._step.rows()
        body = self._old.regions[self._old.chains[self._step.chain].left].body
        wall = Region(self._primitive, (), points, self._step.length * self._step.height, body)
        regions = tuple(
            replace(region, loops=tuple(tuple(loop) for loop in loops))
            for region, loops in zip((*self._old.regions, wall), self.loops)
        )
        return Topology(regions, tuple(self.chains), np.array(self.corners), self._old.volume)
