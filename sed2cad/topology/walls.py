"""Walls of steps and rims that the labels lost: two parallel faces share a border but lie at different heights there.

No edge can lie on both of them. A wall is put between: on the surface of a patch that runs along the border, else
on the plane or cylinder that stands on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.geometry.chains import length
from sed2cad.geometry.web import Web
from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.robust_fit import robust_fit
from sed2cad.primitives.vectors import root_mean_square, unit
from sed2cad.scan.scan import Array, Scan
from sed2cad.topology.model import Region, Topology

LEVEL = 0.97  # cosine between the normals of the two faces, at least; opposite ones are those of a sheet
_STEP = 0.35  # spacings: lower steps are left to the tolerances,
_SURE = 2.0  # and those lower than so many deviations of the noise
_UPRIGHT = 0.85  # cosine between the normals of a wall and of the surface that is to hold it, at least
_ALONG = 0.25  # of the height: a surface so near to the border runs along it
_NEAR = 3.0  # spacings between the border and a point of such a patch
_LOOSE = 0.8  # spacings: rms of the border from the wall that stands on it
_LONG = 2.0  # heights: a shorter border with no such patch is a flaw of the mesh, where a corner is
_LEAST_LENGTH = 4.0  # spacings, for the same reason
_TOO_HIGH = 0.02  # unit frame, twice the gate's tolerance: a step that no edge can bridge is none of these
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
        if step is None or not _is_simple(Web(topology), number):
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
    if len(chain.points) < 2:
        return None
    rise = rise_at(scan, left, right, chain.points)
    if not rise:
        return None
    foot, head = (patch.primitive.project(chain.points) for patch in (left, right))
    around = np.vstack([chain.points[-1:], chain.points, chain.points[:1]])
    ahead = np.gradient(around, axis=0)[1:-1] if chain.closed else np.gradient(chain.points, axis=0)
    up = left.sign * left.primitive.normal(chain.points)
    outward = unit(np.cross(ahead, up)) * -np.sign(rise)  # to the right, where the right face is lower
    return Step(number, chain.closed, foot, head, outward)


def rise_at(scan: Scan, left: FittedPatch, right: FittedPatch, points: Array) -> float:
    """How far the right one of two parallel faces lies above the left along their border, points (n, 3).

    0 where they are not parallel, or where the step is so low that it is none; of freeform faces nothing is known.
    """
    if left.primitive.freeform or right.primitive.freeform:
        return 0.0
    up, other = (patch.sign * patch.primitive.normal(points) for patch in (left, right))
    low, high = (patch.sign * patch.primitive.distance(points) for patch in (left, right))
    cosine = float(np.median(np.einsum("ij,ij->i", up, other)))
    rise = float(np.median(low - np.sign(cosine) * high))
    least = max(_STEP * scan.spacing, _SURE * scan.noise)
    return rise if abs(cosine) >= LEVEL and abs(rise) >= least else 0.0


def _is_simple(web: Web, number: int) -> bool:
    """Whether a chain is closed, or has two corners and different faces, three or more, meet at each."""
    chain = web.chains[number]
    ends = () if chain.closed else (chain.start, chain.end)
    around = [[face for _, face in web.turn(corner)] for corner in ends]
    return chain.closed or (chain.start != chain.end and all(len(set(own)) == len(own) > 2 for own in around))


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
    short = step.length < max(_LONG * step.height, _LEAST_LENGTH * scan.spacing)
    if short and (step.closed or step.height < _TOO_HIGH):
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
    points, _ = step.rows()
    body = topology.regions[topology.chains[step.chain].left].body
    wall = Region(primitive, (), points, step.length * step.height, body)
    web = Web(topology).doubled(step.chain, step.foot, step.head, wall)
    for end in () if step.closed else (0, 1):
        web = _torn(web, step, end, patches)
    return _in_one(web).topology()


def _in_one(web: Web) -> Web:
    """The web whose newest region, a wall, is one with a face beside it that goes on from it on the same surface."""
    wall = len(web.loops) - 1
    beside = {k: web.beside(k, wall) for loop in web.loops[wall] for k, _ in loop}
    same = [k for k, face in beside.items() if web.primitive(face) == web.primitive(wall)]
    return web.united(same[0]) if len(same) == 1 else web


def _torn(web: Web, step: Step, end: int, patches: Sequence[FittedPatch]) -> Web:
    """The corner at an end (0 | 1) of a wall becomes two, its foot and its head, with an edge between.

    The chains there that come first from the right face around go with the head.
    """
    corner, wall = web.corner_of((step.chain, end)), web.chains[step.chain].right
    foot, head = step.foot[-end], step.head[-end]
    turn = web.turn(corner)
    at = [face for _, face in turn].index(wall)
    fan = (turn[at:] + turn[:at])[2:]  # without the wall's two chains
    chains, faces = [ray[0] for ray, _ in fan], [face for _, face in fan[:-1]]
    if end:
        chains, faces = chains[::-1], faces[::-1]
    away = 1
    while away < len(faces) and _off(web, chains[away], head, patches) < _off(web, chains[away], foot, patches):
        away += 1
    beside = [face for _, face in turn].index(faces[away - 1])
    return web.split(corner, *((at, beside) if end else (beside, at)), foot, head)


def _off(web: Web, k: int, point: Array, patches: Sequence[FittedPatch]) -> float:
    """How far a point (3,) is off the surfaces of a chain; of points on both, the nearer is less off."""
    chain = web.chains[k]
    surfaces = [patches[web.primitive(face)].primitive for face in (chain.left, chain.right)]
    inner = chain.points[len(chain.points) // 2]
    return float(sum(abs(s.distance(point[None])[0]) for s in surfaces) + 0.05 * np.linalg.norm(point - inner))
