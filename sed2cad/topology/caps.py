"""Caps that the segmentation missed: the loops around a cylinder or a cone must undo each other's turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import about_axis, root_mean_square, tangent_frame
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.labelling import Adjacency
from sed2cad.topology.mincut import Labels
from sed2cad.topology.model import Chain, Region, Topology

_STEEP = 0.6  # cosine to the axis above which a triangle can be part of a cap,
_FACING = 0.95  # and a point: those of a drill's tip are not
_LEAST_TRIANGLES = 3
_END = 0.15  # of the length of a face about an axis: what lies there is at its end
_PARALLEL = 0.9998  # cosine between the normals of caps that may be at one level, at least
_END_GAP = 3.0  # mean distances of points along a wall: chance leaves more at its end in 5 % of cases
_LIKELY = 2.0  # times that gap, as far as bores of one radius are likely to be equally deep
_SAME = 0.05  # of the radius, between radii and axes that are the same
_ON = 0.15  # spacings: a point so near to a surface lies on it
_NEAR_APEX = 0.02  # unit frame: a cone's region may end at its apex


Round = Cylinder | Cone | Torus | Revolution | BSplineSurface
"""Surfaces about an axis (a B-spline whose base is a cylinder)."""


@dataclass(frozen=True)
class Cap:
    """A plane across the axis at the end of a face, or a tip like those of other bores."""

    patch: FittedPatch
    triangles: Labels
    beyond: int  # which way (1 | -1) along the plane's normal it might lie farther: nobody saw it,
    gap: float  # and by how much: what chance leaves between the last point of the wall and its end
    known: int = -1  # number of the patch, where it is a given one


def turns(primitive: Round, region: Region, chains: Sequence[Chain]) -> float:
    """How often the loops of a region go around the axis, in all; 0 when nothing is missing.

    None does around less than half a turn of the surface, however its traced points jump about the axis of a fillet.
    """
    x, y = tangent_frame(primitive.frame[2] if isinstance(primitive, BSplineSurface) else primitive.axis)
    origin = _origin(primitive)

    def angles(points: Array) -> Array:
        return np.asarray(np.arctan2((points - origin) @ y, (points - origin) @ x))

    seen = np.sort(angles(region.points))
    if len(seen) == 0 or np.diff(seen, append=seen[0] + 2 * np.pi).max() > np.pi:
        return 0.0
    total = 0.0
    for loop in region.loops:
        for index, direction in loop:
            points = chains[index].points
            if chains[index].closed:
                points = np.vstack([points, points[:1]])
            turned = np.unwrap(angles(points))
            total += direction * float(turned[-1] - turned[0])
    return total / (2 * np.pi)


def missing_cap(
    scan: Scan,
    nearest: Callable[[], Labels],
    mesh: Mesh,
    near: Adjacency,
    region: Labels,
    topology: Topology,
    fitted: Sequence[FittedPatch],
) -> Cap | None:
    """The first missing cap; None when nothing is missing. nearest() gives `nearest_centres`."""
    for index, face in enumerate(topology.regions):
        primitive = fitted[face.primitive].primitive
        if not isinstance(primitive, Cylinder | Cone) or not face.loops:
            continue
        if abs(turns(primitive, face, topology.chains)) < 0.5:
            continue
        height, triangle = _loop_height(primitive, face, topology), nearest()
        wall = _heights(primitive, scan.points[_on(primitive, scan, np.flatnonzero(region[triangle] == index))])
        found = _cap(fitted[face.primitive], primitive, mesh, np.flatnonzero(region == index), height, wall)
        if found is not None:
            plane, triangles, beyond = found
            triangles = _in_one(near, region == index, triangles)
            beside = _beside(near, triangles, region, topology)
            known = next((label for label in beside if _is_tip(scan, primitive, fitted[label].primitive)), -1)
            if known >= 0:
                return Cap(fitted[known], triangles, beyond, 0.0, known)
            patch = _as_patch(plane, scan, np.flatnonzero(np.isin(triangle, triangles)))
            if len(wall) == 0 or len(patch.patch.indices):
                return Cap(patch, triangles, beyond, 0.0)
            gap = _END_GAP * float(np.ptp(wall)) / len(wall)
            tip = tip_elsewhere(fitted[face.primitive], plane, beyond, gap, fitted)
            return Cap(patch if tip is None else replace(tip, patch=patch.patch), triangles, beyond, gap)
    return None


def tip_elsewhere(
    bore: FittedPatch, end: Plane, beyond: int, gap: float, fitted: Sequence[FittedPatch]
) -> FittedPatch | None:
    """The tip of another bore of the same radius and direction at its place in a bore that ends at or beyond a plane,
    which way along its normal and how far is given; None where there is none."""
    wall = bore.primitive
    if not isinstance(wall, Cylinder):
        return None
    out = beyond * end.normal_vector
    for other in fitted:
        tip = other.primitive
        if not isinstance(tip, Cone) or other.sign != bore.sign or tip.axis @ out > -_PARALLEL:
            continue
        rim = tip.apex + wall.radius / np.tan(tip.half_angle) * tip.axis
        if not -gap < beyond * float(end.distance(rim[None])[0]) < _LIKELY * gap:
            continue
        if any(_ends_in(other_wall, tip, wall.radius) for other_wall in fitted if other_wall is not bore):
            height = float((tip.apex - wall.point) @ wall.axis)
            moved = replace(tip, apex=wall.point + height * wall.axis, axis=-out)
            return replace(other, primitive=moved)
    return None


def _ends_in(bore: FittedPatch, tip: Cone, radius: float) -> bool:
    """Whether a bore of some radius has this tip."""
    wall = bore.primitive
    if not isinstance(wall, Cylinder) or abs(wall.radius - radius) > _SAME * radius:
        return False
    aside = about_axis(tip.apex[None], wall.point, wall.axis)[1][0]
    return bool(abs(wall.axis @ tip.axis) > _PARALLEL and aside < _SAME * radius)


def _beside(near: Adjacency, triangles: Labels, region: Labels, topology: Topology) -> list[int]:
    """The patches beside some triangles, whose regions (f,) are given."""
    sides = np.isin(near.pairs, triangles)
    outside = region[near.pairs[sides[:, ::-1] & ~sides]]
    return [topology.regions[number].primitive for number in np.unique(outside).tolist()]


def _is_tip(scan: Scan, wall: Cylinder | Cone, other: Primitive) -> bool:
    """Whether a surface beside the end of a wall closes it there, as a drill's tip does a bore."""
    if not isinstance(other, Cone) or abs(other.axis @ wall.axis) < _PARALLEL:
        return False
    return float(about_axis(other.apex[None], _origin(wall), wall.axis)[1][0]) < 2 * scan.noise + _ON * scan.spacing


def levelled(caps: Sequence[Cap], mesh: Mesh) -> list[FittedPatch]:
    """The patches of caps, planes at one level as far as their walls can tell all at that of the deepest."""
    flat = [(k, plane) for k, cap in enumerate(caps) if isinstance(plane := cap.patch.primitive, Plane)]
    patches = [cap.patch for cap in caps]
    if not flat:
        return patches
    level = [caps[k] for k, _ in flat]
    middles = mesh.centroids()
    centres = np.array([middles[cap.triangles].mean(axis=0) for cap in level])
    normals, beyond = np.array([plane.normal_vector for _, plane in flat]), np.array([cap.beyond for cap in level])
    depths = -beyond * np.column_stack([plane.distance(centres) for _, plane in flat])  # (k, k) at each, of each
    deeper = depths - np.diag(depths)[:, None]
    gaps = np.array([cap.gap for cap in level])[:, None]
    alike = (normals @ normals.T > _PARALLEL) & (beyond[:, None] == beyond)
    group = components(len(level), np.argwhere(alike & (deeper >= 0) & (deeper <= gaps)))[1]
    moves = beyond * np.where(group[:, None] == group, deeper, 0.0).max(axis=1)
    for (k, plane), by in zip(flat, moves):
        patches[k] = replace(caps[k].patch, primitive=Plane(plane.normal_vector, plane.offset + float(by)))
    return patches


def _origin(primitive: Round) -> Array:
    """A point (3,) of the axis."""
    if isinstance(primitive, Revolution | BSplineSurface):
        return primitive.origin
    if isinstance(primitive, Torus):
        return primitive.centre
    return primitive.apex if isinstance(primitive, Cone) else primitive.point


def _heights(primitive: Cylinder | Cone, points: Array) -> Array:
    """Positions (n,) along the axis."""
    return np.asarray((points - _origin(primitive)) @ primitive.axis)


def _loop_height(primitive: Cylinder | Cone, face: Region, topology: Topology) -> float:
    """Mean height of the loops that there are."""
    points = np.vstack([topology.chains[chain].points for loop in face.loops for chain, _ in loop])
    return float(_heights(primitive, points).mean())


def nearest_centres(scan: Scan, mesh: Mesh) -> Labels:
    """The triangle (n,) whose centre is nearest to each point of the scan."""
    return np.asarray(cKDTree(mesh.centroids()).query(scan.points, workers=-1)[1])


def _on(primitive: Primitive, scan: Scan, indices: Labels) -> Labels:
    """Which of some points of the scan lie on a surface."""
    off = np.abs(primitive.distance(scan.points[indices]))
    return indices[off < 2 * scan.noise + _ON * scan.spacing]


def _cap(
    patch: FittedPatch, primitive: Cylinder | Cone, mesh: Mesh, triangles: Labels, loop_height: float, wall: Array
) -> tuple[Plane, Labels, int] | None:
    """The plane at the end of the region that has no loop, which of its triangles are on it, and which way (1 | -1)
    along its normal leads out of the region.

    It lies beyond all points of the wall, whose heights (n,) are given: the mesh rounds floors that nobody saw.
    """
    heights = _heights(primitive, mesh.centroids()[triangles])
    span = float(np.ptp(heights))
    upper = heights.max() - loop_height > loop_height - heights.min()
    end = float(heights.max() if upper else heights.min())
    if isinstance(primitive, Cone) and abs(end) < _NEAR_APEX:
        return None
    normals, areas = mesh.face_normals()
    along = normals[triangles] @ primitive.axis
    reach = np.abs(heights - end)
    facing = np.sign((along * areas[triangles])[reach < _END * span + 1e-9].sum())
    on_cap = (along * facing > _STEEP) & (reach < 0.4 * span + 1e-9)
    pointed = isinstance(primitive, Cone) and not upper
    if on_cap.sum() < _LEAST_TRIANGLES and not pointed:  # the floor of a bore that nobody saw
        facing = patch.sign * (1.0 if upper else -1.0)
        on_cap = reach < _END * span
    if on_cap.sum() < _LEAST_TRIANGLES or on_cap.all():
        return None
    height = float(np.median(heights[on_cap]))
    height = float(wall.max(initial=height) if upper else wall.min(initial=height))
    normal = facing * primitive.axis
    if not _around(primitive, mesh, triangles[on_cap]):
        on_cap = reach <= reach[on_cap].max()
    plane = Plane(normal, float(normal @ (_origin(primitive) + height * primitive.axis)))
    return plane, triangles[on_cap], int(facing) if upper else -int(facing)


def _around(primitive: Cylinder | Cone, mesh: Mesh, triangles: Labels) -> bool:
    """Whether the axis goes through triangles: the border of a cap that it misses does not go around it."""
    x, y = tangent_frame(primitive.axis)
    corners = mesh.vertices[mesh.faces[triangles]] - _origin(primitive)
    angles = np.arctan2(corners @ y, corners @ x)
    steps = np.roll(angles, -1, axis=1) - angles
    return bool(abs(((steps + np.pi) % (2 * np.pi) - np.pi).sum()) > np.pi)


def _in_one(near: Adjacency, inside: NDArray[np.bool_], cap: Labels) -> Labels:
    """The largest piece of the triangles of a cap, with what it cuts off from the rest of its region (f,)."""
    rest = inside & ~np.isin(np.arange(len(inside)), _largest(near, cap, len(inside)))
    return np.setdiff1d(np.flatnonzero(inside), _largest(near, np.flatnonzero(rest), len(inside)))


def _largest(near: Adjacency, triangles: Labels, count: int) -> Labels:
    """The connected piece with the most of some of `count` triangles."""
    chosen = np.isin(np.arange(count), triangles)
    number, piece = components(count, near.pairs[chosen[near.pairs].all(axis=1)])
    return triangles[piece[triangles] == np.bincount(piece[triangles], minlength=number).argmax()]


def _as_patch(plane: Plane, scan: Scan, near: Labels) -> FittedPatch:
    """The plane with those of the points near to it that lie on it."""
    indices = _on(plane, scan, near)
    indices = indices[scan.normals[indices] @ plane.normal_vector > _FACING]
    interior = np.ones(len(indices), dtype=bool)
    distance = plane.distance(scan.points[indices])
    rms = root_mean_square(distance) if len(indices) else scan.spacing
    spread = max(rms, scan.noise, 0.1 * scan.spacing) ** 2
    return FittedPatch(Patch(indices, "plane", interior), plane, 1, rms, spread * np.eye(Plane.freedom))
