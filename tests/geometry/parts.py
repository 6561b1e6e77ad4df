"""Topologies made by hand, as `trace` would give them, with the volume and area of the part in closed form.

Lengths are free: `in_unit` brings a part into the unit frame. Chain points can be given noise, as from a
mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.scan.scan import Frame
from sed2cad.topology.model import Chain, Region, Topology

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)
PI = np.pi


@dataclass(frozen=True)
class Part:
    """A topology with its surfaces, and what the solid must measure."""

    topology: Topology
    fitted: tuple[FittedPatch, ...]
    volume: float
    area: float
    kinds: tuple[str, ...]  # of the faces, in order of the regions
    frame: Frame

    @property
    def points(self) -> Array:
        """Points (n, 3) of the surface, unit frame."""
        return np.vstack([region.points for region in self.topology.regions])

    def noisy(self, share: float, seed: int = 0) -> Part:
        """Chain points and corners moved at random by `share` of the diagonal at most."""
        rng = np.random.default_rng(seed)

        def moved(points: Array) -> Array:
            return points + share * rng.uniform(-1, 1, points.shape)

        chains = tuple(replace(c, points=moved(c.points)) for c in self.topology.chains)
        topology = replace(self.topology, chains=chains, corners=moved(self.topology.corners))
        return replace(self, topology=topology)


class Builder:
    """Collects surfaces, corners, chains and loops in any unit."""

    def __init__(self) -> None:
        self.primitives: list[tuple[Primitive, int]] = []
        self.corners: list[Array] = []
        self.chains: list[tuple[Array, int, int, int, int]] = []
        self.loops: dict[int, list[list[tuple[int, int]]]] = {}

    def face(self, primitive: Primitive, sign: int = 1) -> int:
        """A region on its own surface."""
        self.primitives.append((primitive, sign))
        self.loops[len(self.primitives) - 1] = []
        return len(self.primitives) - 1

    def corner(self, *point: float) -> int:
        self.corners.append(np.array(point, float))
        return len(self.corners) - 1

    def line(self, start: int, end: int, left: int, right: int, count: int = 24) -> int:
        """A straight chain between corners."""
        points = np.linspace(self.corners[start], self.corners[end], count)
        return self.chain(points, left, right, start, end)

    def chain(self, points: Array, left: int, right: int, start: int = -1, end: int = -1) -> int:
        self.chains.append((points, left, right, start, end))
        return len(self.chains) - 1

    def ring(self, curve: Callable[[Array], Array], left: int, right: int, count: int = 60) -> int:
        """A closed chain, a loop of its own for both faces; curve(angles) with the left face on its left."""
        k = self.chain(curve(np.linspace(0, 2 * PI, count, endpoint=False)), left, right)
        self.loop(left, (k, 1))
        self.loop(right, (k, -1))
        return k

    def loop(self, face: int, *steps: tuple[int, int]) -> None:
        self.loops[face].append(list(steps))

    def part(
        self,
        volume: float,
        area: float,
        bodies: Sequence[int] | None = None,
        box: tuple[Sequence[float], Sequence[float]] | None = None,
    ) -> Part:
        """Everything in the unit frame; the part's measures stay in the unit it was built in."""
        every = np.array(box) if box else np.vstack([c[0] for c in self.chains])
        low, high = every.min(axis=0), every.max(axis=0)
        frame = Frame((low + high) / 2, float(np.linalg.norm(high - low)))
        chains = tuple(Chain(frame.to_unit(p), *rest) for p, *rest in self.chains)
        corners = frame.to_unit(np.array(self.corners).reshape(-1, 3))
        fitted, regions = [], []
        for r, (primitive, sign) in enumerate(self.primitives):
            unit = primitive.scaled(1 / frame.scale, -frame.origin / frame.scale)
            nothing = Patch(np.zeros(0, np.int64), unit.kind, np.zeros(0, bool))
            fitted.append(FittedPatch(nothing, unit, sign, 0.0, np.zeros((unit.freedom, unit.freedom))))
            loops = tuple(tuple(loop) for loop in self.loops[r])
            points = [chains[k].points for loop in loops for k, _ in loop] or [unit.project(_everywhere())]
            body = bodies[r] if bodies else 0
            regions.append(Region(r, loops, np.vstack(points), area / frame.scale**2 / len(self.primitives), body))
        topology = Topology(tuple(regions), chains, corners, volume / frame.scale**3)
        kinds = tuple(p.kind for p, _ in self.primitives)
        return Part(topology, tuple(fitted), volume, area, kinds, frame)


def _everywhere() -> Array:
    """Points (n, 3) in all directions, for closed surfaces."""
    return np.random.default_rng(0).uniform(-1, 1, size=(400, 3)) * [0.6, 0.6, 0.1]


def circle(centre: Sequence[float], axis: Array, radius: float) -> Callable[[Array], Array]:
    """Angles to points, counter-clockwise about the axis."""
    x = np.roll(np.abs(axis), 1)  # for axes along x, y, z
    y = np.cross(axis, x)
    return lambda t: np.array(centre, float) + radius * (np.outer(np.cos(t), x) + np.outer(np.sin(t), y))


def prism(
    b: Builder,
    outline: Sequence[tuple[float, float]],
    height: float,
    walls: Sequence[int],
    top: int,
    bottom: int,
) -> list[int]:
    """Edges and loops of a straight-sided prism on given faces; the upright chains."""
    n = len(outline)
    low = [b.corner(x, y, 0) for x, y in outline]
    high = [b.corner(x, y, height) for x, y in outline]
    lows = [b.line(low[k], low[(k + 1) % n], walls[k], bottom) for k in range(n)]
    highs = [b.line(high[k], high[(k + 1) % n], top, walls[k]) for k in range(n)]
    ups = [b.line(low[k], high[k], walls[k - 1], walls[k]) for k in range(n)]
    b.loop(top, *[(k, 1) for k in highs])
    b.loop(bottom, *[(k, -1) for k in lows[::-1]])
    for k in range(n):
        b.loop(walls[k], (lows[k], 1), (ups[(k + 1) % n], 1), (highs[k], -1), (ups[k], -1))
    return ups


def _box_faces(b: Builder, size: tuple[float, float, float]) -> tuple[list[int], int, int]:
    """Walls (front, right, back, left), top and bottom of a box from the origin."""
    sx, sy, sz = size
    walls = [b.face(Plane(-Y, 0.0)), b.face(Plane(X, sx)), b.face(Plane(Y, sy)), b.face(Plane(-X, 0.0))]
    return walls, b.face(Plane(Z, sz)), b.face(Plane(-Z, 0.0))


def box(size: tuple[float, float, float] = (30.0, 20.0, 10.0)) -> Part:
    """Six planes."""
    b = Builder()
    walls, top, bottom = _box_faces(b, size)
    sx, sy, sz = size
    prism(b, [(0, 0), (sx, 0), (sx, sy), (0, sy)], sz, walls, top, bottom)
    return b.part(sx * sy * sz, 2 * (sx * sy + sy * sz + sx * sz))


def wedge(end: float) -> Part:
    """A block that runs out, under 10 degrees, to a narrow wall: that between its first and its last corner."""
    b = Builder()
    length, height = 30.0, 20.0
    slope = np.radians(10)
    wide = end + length * np.tan(slope)
    leaning = np.array([-np.sin(slope), np.cos(slope), 0.0])
    walls = [b.face(Plane(-Y, 0.0)), b.face(Plane(X, length)), b.face(Plane(leaning, end * np.cos(slope)))]
    walls.append(b.face(Plane(-X, 0.0)))
    top, bottom = b.face(Plane(Z, height)), b.face(Plane(-Z, 0.0))
    prism(b, [(0, 0), (length, 0), (length, wide), (0, end)], height, walls, top, bottom)
    base, side = length * (end + wide) / 2, height * (length + wide + length / np.cos(slope) + end)
    return b.part(base * height, 2 * base + side)


def hip_roof(ridge: float = 4.0) -> Part:
    """Four slopes of 45 degrees over a rectangle; their two peaks are joined by a ridge along X.

    Without a ridge it is a pyramid, its peak the last corner.
    """
    b = Builder()
    half, length = 10.0, 10.0 + ridge / 2
    base = b.face(Plane(-Z, 0.0))
    outline = [(-length, -half), (length, -half), (length, half), (-length, half)]
    slope = np.sqrt(0.5)
    ways = [-Y, X, Y, -X]
    reach = [half, length, half, length]
    sides = [b.face(Plane((w + Z) * slope, slope * r)) for w, r in zip(ways, reach)]
    low = [b.corner(x, y, 0) for x, y in outline]
    left = b.corner(-ridge / 2, 0, half)
    right = left if ridge == 0 else b.corner(ridge / 2, 0, half)
    peaks = [left, right, right, left]
    rims = [b.line(low[k], low[(k + 1) % 4], sides[k], base) for k in range(4)]
    hips = [b.line(low[k], peaks[k], sides[k - 1], sides[k]) for k in range(4)]
    b.loop(base, *[(k, -1) for k in rims[::-1]])
    top = [b.line(right, left, sides[0], sides[2])] if ridge else []
    for k in range(4):
        over = [(c, 1 if k == 0 else -1) for c in top] if k % 2 == 0 else []
        b.loop(sides[k], (rims[k], 1), (hips[(k + 1) % 4], 1), *over, (hips[k], -1))
    volume = 2 / 3 * 2 * half * half * half + ridge * half * half
    floor = 4 * half * length
    return b.part(volume, floor * (1 + np.sqrt(2)))


def pyramid() -> Part:
    """Four faces in one corner, the last one."""
    return hip_roof(0.0)


def box_with_hole(radius: float = 4.0) -> Part:
    """A round hole straight through, its cylinder looking inwards."""
    b = Builder()
    walls, top, bottom = _box_faces(b, (30.0, 20.0, 10.0))
    prism(b, [(0, 0), (30, 0), (30, 20), (0, 20)], 10.0, walls, top, bottom)
    hole = b.face(Cylinder(Z, np.array([12.0, 9.0, 0.0]), radius), -1)
    b.ring(circle((12, 9, 10), -Z, radius), top, hole)
    b.ring(circle((12, 9, 0), Z, radius), bottom, hole)
    area = 2 * (600 + 200 + 300) - 2 * PI * radius**2 + 2 * PI * radius * 10
    return b.part(6000 - PI * radius**2 * 10, area)


def stepped_shaft() -> Part:
    """Two cylinders on one axis, a shoulder between them."""
    b = Builder()
    thick, thin = b.face(Cylinder(Z, np.zeros(3), 10.0)), b.face(Cylinder(Z, np.zeros(3), 6.0))
    bottom, shoulder, top = b.face(Plane(-Z, 0.0)), b.face(Plane(Z, 20.0)), b.face(Plane(Z, 45.0))
    b.ring(circle((0, 0, 0), Z, 10.0), thick, bottom)
    b.ring(circle((0, 0, 20), Z, 10.0), shoulder, thick)
    b.ring(circle((0, 0, 20), Z, 6.0), thin, shoulder)
    b.ring(circle((0, 0, 45), Z, 6.0), top, thin)
    volume = PI * (100 * 20 + 36 * 25)
    return b.part(volume, PI * (2 * 100 + 20 * 20 + 12 * 25))


def filleted_box(radius: float = 3.0) -> Part:
    """A box with one edge rounded: a quarter cylinder tangent to top and right wall."""
    b = Builder()
    sx, sy, sz, r = 30.0, 20.0, 10.0, radius
    front, back = b.face(Plane(-Y, 0.0)), b.face(Plane(Y, sy))
    right, left = b.face(Plane(X, sx)), b.face(Plane(-X, 0.0))
    top, bottom = b.face(Plane(Z, sz)), b.face(Plane(-Z, 0.0))
    fillet = b.face(Cylinder(Y, np.array([sx - r, 0.0, sz - r]), r))
    p = [(0, 0), (sx, 0), (sx, sz - r), (sx - r, sz), (0, sz)]  # the profile in x, z
    f = [b.corner(x, 0, z) for x, z in p]
    k = [b.corner(x, sy, z) for x, z in p]
    arc = np.linspace(0, PI / 2, 16)[:, None]
    quarter = np.array([sx - r, 0, sz - r]) + r * (np.cos(arc) * X + np.sin(arc) * Z)
    sides = [bottom, right, fillet, top, left]
    fronts = [b.line(f[i], f[(i + 1) % 5], front, sides[i]) for i in (0, 1)]
    fronts += [b.chain(quarter, front, fillet, f[2], f[3])]
    fronts += [b.line(f[i], f[(i + 1) % 5], front, sides[i]) for i in (3, 4)]
    backs = [b.line(k[i], k[(i + 1) % 5], sides[i], back) for i in (0, 1)]
    backs += [b.chain(quarter + sy * Y, fillet, back, k[2], k[3])]
    backs += [b.line(k[i], k[(i + 1) % 5], sides[i], back) for i in (3, 4)]
    along = [b.line(f[i], k[i], sides[i], sides[i - 1]) for i in range(5)]
    b.loop(front, *[(c, 1) for c in fronts])
    b.loop(back, *[(c, -1) for c in backs[::-1]])
    for i in range(5):
        b.loop(sides[i], (along[i], 1), (backs[i], 1), (along[(i + 1) % 5], -1), (fronts[i], -1))
    lost = (1 - PI / 4) * r * r
    ring = 2 * (sx + sz) - 2 * r + PI / 2 * r
    return b.part((sx * sz - lost) * sy, 2 * (sx * sz - lost) + ring * sy)


def cone_frustum() -> Part:
    """A cone between two planes."""
    b = Builder()
    side = b.face(Cone(-Z, np.array([0.0, 0.0, 20.0]), float(np.arctan(0.5))))
    bottom, top = b.face(Plane(-Z, 0.0)), b.face(Plane(Z, 12.0))
    b.ring(circle((0, 0, 0), Z, 10.0), side, bottom)
    b.ring(circle((0, 0, 12), Z, 4.0), top, side)
    slant = np.hypot(12, 6)
    return b.part(PI * 12 / 3 * (100 + 40 + 16), PI * (100 + 16 + 14 * slant))


def whole_cone() -> Part:
    """A cone up to its apex."""
    b = Builder()
    side = b.face(Cone(-Z, np.array([0.0, 0.0, 20.0]), float(np.arctan(0.5))))
    bottom = b.face(Plane(-Z, 0.0))
    b.ring(circle((0, 0, 0), Z, 10.0), side, bottom)
    return b.part(PI * 100 * 20 / 3, PI * (100 + 10 * np.hypot(10, 20)))


def pill() -> Part:
    """A cylinder that ends in a plane below and a tangent hemisphere above."""
    b = Builder()
    side, bottom = b.face(Cylinder(Z, np.zeros(3), 5.0)), b.face(Plane(-Z, 0.0))
    dome = b.face(Sphere(np.array([0.0, 0.0, 12.0]), 5.0))
    b.ring(circle((0, 0, 0), Z, 5.0), side, bottom)
    b.ring(circle((0, 0, 12), Z, 5.0), dome, side)
    return b.part(PI * (25 * 12 + 2 / 3 * 125), PI * (25 + 10 * 12 + 50))


def grooved_shaft() -> Part:
    """A half-round groove: the inward half of a torus."""
    b = Builder()
    low, high = b.face(Cylinder(Z, np.zeros(3), 10.0)), b.face(Cylinder(Z, np.zeros(3), 10.0))
    bottom, top = b.face(Plane(-Z, 0.0)), b.face(Plane(Z, 30.0))
    groove = b.face(Torus(Z, np.array([0.0, 0.0, 15.0]), 10.0, 2.0), -1)
    b.ring(circle((0, 0, 0), Z, 10.0), low, bottom)
    b.ring(circle((0, 0, 13), Z, 10.0), groove, low)
    b.ring(circle((0, 0, 17), Z, 10.0), high, groove)
    b.ring(circle((0, 0, 30), Z, 10.0), top, high)
    volume = PI * 100 * 30 - 2 * PI * (10 - 8 / (3 * PI)) * (PI * 2)
    area = 2 * PI * 100 + 20 * PI * 26 + PI * 2 * 2 * PI * (10 - 4 / PI)
    return b.part(volume, area)


def beaded_shaft() -> Part:
    """A half-round bead: the outward half of a torus, across the kernel's own seam of the tube."""
    b = Builder()
    low, high = b.face(Cylinder(Z, np.zeros(3), 10.0)), b.face(Cylinder(Z, np.zeros(3), 10.0))
    bottom, top = b.face(Plane(-Z, 0.0)), b.face(Plane(Z, 30.0))
    bead = b.face(Torus(Z, np.array([0.0, 0.0, 15.0]), 10.0, 2.0))
    b.ring(circle((0, 0, 0), Z, 10.0), low, bottom)
    b.ring(circle((0, 0, 13), Z, 10.0), bead, low)
    b.ring(circle((0, 0, 17), Z, 10.0), high, bead)
    b.ring(circle((0, 0, 30), Z, 10.0), top, high)
    volume = PI * 100 * 30 + 2 * PI * (10 + 8 / (3 * PI)) * (PI * 2)
    area = 2 * PI * 100 + 20 * PI * 26 + PI * 2 * 2 * PI * (10 + 4 / PI)
    return b.part(volume, area)


def elbow() -> Part:
    """A quarter of a torus between two planes: loops around the tube."""
    b = Builder()
    tube = b.face(Torus(Z, np.zeros(3), 20.0, 5.0))
    first, last = b.face(Plane(-Y, 0.0)), b.face(Plane(-X, 0.0))
    b.ring(circle((20, 0, 0), -Y, 5.0), first, tube)
    b.ring(circle((0, 20, 0), -X, 5.0), last, tube)
    return b.part(PI * 25 * 10 * PI, 2 * PI * 25 + 10 * PI * 10 * PI)


def pipe_bend() -> Part:
    """An elbow that goes on in straight, tangent cylinders."""
    b = Builder()
    tube = b.face(Torus(Z, np.zeros(3), 20.0, 5.0))
    down, away = (
        b.face(Cylinder(Y, np.array([20.0, 0.0, 0.0]), 5.0)),
        b.face(Cylinder(X, np.array([0.0, 20.0, 0.0]), 5.0)),
    )
    first, last = b.face(Plane(-Y, 15.0)), b.face(Plane(-X, 10.0))
    b.ring(circle((20, 0, 0), -Y, 5.0), down, tube)
    b.ring(circle((0, 20, 0), -X, 5.0), away, tube)
    b.ring(circle((20, -15, 0), -Y, 5.0), first, down)
    b.ring(circle((-10, 20, 0), -X, 5.0), last, away)
    return b.part(PI * 25 * (10 * PI + 25), 2 * PI * 25 + 10 * PI * (10 * PI + 25))


def ball() -> Part:
    """A whole sphere: a region without loops."""
    b = Builder()
    b.face(Sphere(np.array([1.0, 2.0, 3.0]), 4.0))
    return b.part(4 / 3 * PI * 64, 4 * PI * 16, box=((-3, -2, -1), (5, 6, 7)))


def ring() -> Part:
    """A whole torus."""
    b = Builder()
    b.face(Torus(Z, np.zeros(3), 10.0, 3.0))
    return b.part(2 * PI**2 * 10 * 9, 4 * PI**2 * 30, box=((-13, -13, -3), (13, 13, 3)))


def _halved_disc(b: Builder, cap: int, radius: float) -> None:
    """Close a face whose rim is a circle about Z from below by two half discs: its ring has two edges."""
    left, right = b.face(Plane(-Z, 0.0)), b.face(Plane(-Z, 0.0))
    p, q = b.corner(0, -radius, 0), b.corner(0, radius, 0)
    t = np.linspace(-PI / 2, PI / 2, 30)
    half = radius * np.column_stack([np.cos(t), np.sin(t), np.zeros(30)])
    there, back = b.chain(half, cap, right, p, q), b.chain(-half, cap, left, q, p)
    across = b.line(p, q, right, left)
    b.loop(cap, (there, 1), (back, 1))
    b.loop(right, (there, -1), (across, 1))
    b.loop(left, (back, -1), (across, -1))


def halved_cone() -> Part:
    """A whole cone whose ring has two edges."""
    b = Builder()
    side = b.face(Cone(-Z, np.array([0.0, 0.0, 20.0]), float(np.arctan(0.5))))
    _halved_disc(b, side, 10.0)
    return b.part(PI * 100 * 20 / 3, PI * (100 + 10 * np.hypot(10, 20)))


def halved_dome() -> Part:
    """A hemisphere whose ring has two edges."""
    b = Builder()
    dome = b.face(Sphere(np.zeros(3), 10.0))
    _halved_disc(b, dome, 10.0)
    return b.part(2 / 3 * PI * 1000, PI * 300)


def pencil(half: float = 10.0, height: float = 40.0) -> Part:
    """A square bar under a cone of 45 degrees: the ring around the tip is made of four hyperbolas."""
    b = Builder()
    tip = b.face(Cone(-Z, np.array([0.0, 0.0, height]), PI / 4))
    ways = [-Y, X, Y, -X]
    walls = [b.face(Plane(way, half)) for way in ways]
    base = b.face(Plane(-Z, 0.0))
    outline = [(-half, -half), (half, -half), (half, half), (-half, half)]
    top = height - half * np.sqrt(2)
    low = [b.corner(x, y, 0) for x, y in outline]
    high = [b.corner(x, y, top) for x, y in outline]
    lows = [b.line(low[k], low[(k + 1) % 4], walls[k], base) for k in range(4)]
    ups = [b.line(low[k], high[k], walls[k - 1], walls[k]) for k in range(4)]
    t = np.linspace(-half, half, 40)
    rings = []
    for k in range(4):
        along = np.cross(Z, ways[k])
        points = half * ways[k] + np.outer(t, along) + np.outer(height - np.hypot(half, t), Z)
        rings.append(b.chain(points, tip, walls[k], high[k], high[(k + 1) % 4]))
    b.loop(tip, *[(k, 1) for k in rings])
    b.loop(base, *[(k, -1) for k in lows[::-1]])
    for k in range(4):
        b.loop(walls[k], (lows[k], 1), (ups[(k + 1) % 4], 1), (rings[k], -1), (ups[k], -1))
    reach = np.sqrt(2) + np.log(1 + np.sqrt(2))
    volume = 4 * half**2 * height - 4 / 3 * half**3 * reach
    area = 4 * half**2 * (1 + np.sqrt(2)) + 4 * (2 * half * height - half**2 * reach)
    return b.part(volume, area)


def hollow_box() -> Part:
    """A box with a spherical cavity: two bodies, one of them inside out."""
    outer = box()
    b = Builder()
    walls, top, bottom = _box_faces(b, (30.0, 20.0, 10.0))
    prism(b, [(0, 0), (30, 0), (30, 20), (0, 20)], 10.0, walls, top, bottom)
    b.face(Sphere(np.array([15.0, 10.0, 5.0]), 3.0), -1)
    return b.part(6000 - 36 * PI, outer.area + 36 * PI, bodies=[0] * 6 + [1])


def two_boxes() -> Part:
    """Two bodies apart."""
    b = Builder()
    for x in (0.0, 40.0):
        walls = [
            b.face(Plane(-Y, 0.0)),
            b.face(Plane(X, x + 10)),
            b.face(Plane(Y, 10.0)),
            b.face(Plane(-X, -x)),
        ]
        top, bottom = b.face(Plane(Z, 10.0)), b.face(Plane(-Z, 0.0))
        prism(b, [(x, 0), (x + 10, 0), (x + 10, 10), (x, 10)], 10.0, walls, top, bottom)
    return b.part(2000.0, 1200.0, bodies=[0] * 6 + [1] * 6)


def crossing_pipes() -> Part:
    """A thin cylinder growing out of a thick one: a saddle-shaped edge that is no simple curve."""
    b = Builder()
    thick, thin = b.face(Cylinder(Z, np.zeros(3), 10.0)), b.face(Cylinder(X, np.zeros(3), 5.0))
    bottom, top, end = b.face(Plane(-Z, 20.0)), b.face(Plane(Z, 20.0)), b.face(Plane(X, 25.0))
    b.ring(circle((0, 0, -20), Z, 10.0), thick, bottom)
    b.ring(circle((0, 0, 20), Z, 10.0), top, thick)
    b.ring(circle((25, 0, 0), X, 5.0), end, thin)

    def saddle(t: Array) -> Array:
        y, z = 5 * np.cos(t), 5 * np.sin(t)
        return np.column_stack([np.sqrt(100 - y**2), y, z])

    b.ring(saddle, thin, thick)
    t = np.linspace(0, 2 * PI, 20001)[:-1]
    reach = np.sqrt(100 - 25 * np.cos(t) ** 2)
    r, a = np.meshgrid((np.arange(2000) + 0.5) / 400, t[::50])
    depth = np.sqrt(100 - (r * np.cos(a)) ** 2)
    inside = float((depth * r).mean() * 5 * 2 * PI)
    thin_area = float((25 - reach).mean() * 10 * PI)
    # area of the thick cylinder under the thin one: dA = 10 / x dy dz over the disc
    lost = float((10 / depth * r).mean() * 5 * 2 * PI)
    volume = PI * 100 * 40 + PI * 25 * 25 - inside
    area = 2 * PI * 100 + 20 * PI * 40 - lost + PI * 25 + thin_area
    return b.part(volume, area)


EXACT: dict[str, Callable[[], Part]] = {
    f.__name__: f
    for f in (
        box,
        hip_roof,
        pyramid,
        box_with_hole,
        stepped_shaft,
        filleted_box,
        cone_frustum,
        whole_cone,
        pill,
        grooved_shaft,
        beaded_shaft,
        elbow,
        pipe_bend,
        ball,
        ring,
        halved_cone,
        halved_dome,
        hollow_box,
        two_boxes,
    )
}
