"""Parts with swept faces made by hand, as `parts` does: spline profiles along a direction or about an axis."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import make_interp_spline

from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.profile import Profile
from sed2cad.primitives.revolution import Revolution
from tests.geometry.parts import PI, Array, Builder, Part, X, Y, Z


def through(points: Array, closed: bool = False) -> Profile:
    """The profile through points (n, 2); a closed one comes back to the first."""
    if not closed:
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        spline = make_interp_spline(along, points, k=3)
        return Profile(spline.t, spline.c, False)
    points = np.vstack([points, points[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    spline = make_interp_spline(along, points, k=3, bc_type="periodic")
    return Profile(spline.t, spline.c, True)


def ellipse(a: float, b: float) -> Profile:
    """Counter-clockwise, to about 1e-5."""
    t = np.linspace(0, 2 * PI, 32, endpoint=False)
    return through(np.column_stack([a * np.cos(t), b * np.sin(t)]), closed=True)


def along(profile: Profile, height: float, count: int) -> Array:
    """Points (count, 3) of a profile over the x, y plane."""
    low, high = profile.ends
    t = np.linspace(low, high, count, endpoint=not profile.closed)
    return np.column_stack([profile.at(t), np.full(count, height)])


def enclosed(profile: Profile) -> float:
    """The area to the left of a profile, closed by straight lines from the origin (Green)."""

    def sector(t: float) -> float:
        at = np.array([t])
        (x, y), (dx, dy) = profile.at(at)[0], profile._curves[1](at)[0]
        return float(x * dy - y * dx) / 2

    inner = np.unique(profile.knots[3:-3])
    return sum(quad(sector, a, b)[0] for a, b in pairwise(inner))


def turned_volume(profile: Profile) -> float:
    """The volume between a profile (r, z) that runs upwards and its axis."""

    def disc(t: float) -> float:
        at = np.array([t])
        return float(PI * profile.at(at)[0, 0] ** 2 * profile._curves[1](at)[0, 1])

    inner = np.unique(profile.knots[3:-3])
    return sum(quad(disc, a, b)[0] for a, b in pairwise(inner))


def tube(outer: tuple[float, float] = (12.0, 7.0), inner: tuple[float, float] = (8.0, 4.0)) -> Part:
    """An elliptic tube: two closed profiles, a bore and two rings."""
    b = Builder()
    height = 15.0
    origin = np.array([0.0, 0.0, 3.0])
    wall, bore = ellipse(*outer), ellipse(*inner)
    outside = b.face(Extrusion(Z, origin, X, wall))
    inside = b.face(Extrusion(-Z, origin, X, through(bore.at(np.linspace(*bore.ends, 33))[:-1] * [1, -1], True)))
    b.primitives[inside] = (b.primitives[inside][0], 1 if _inwards(b.primitives[inside][0]) else -1)
    top, bottom = b.face(Plane(Z, height)), b.face(Plane(-Z, 0.0))
    for profile, face, way in ((wall, outside, 1), (bore, inside, -1)):
        for level, ring in ((height, top), (0.0, bottom)):
            chain = along(profile, level, 60)
            chain = chain if (way > 0) == (level > 0) else chain[::-1]
            k = b.chain(chain, ring, face)
            b.loop(ring, (k, 1))
            b.loop(face, (k, -1))
    return b.part((enclosed(wall) - enclosed(bore)) * height, 1000.0)


def _inwards(surface: Extrusion) -> bool:
    """Whether the normal of a closed wall points to its axis."""
    point = surface.project(np.array([[30.0, 0.0, 0.0]]))
    return bool(surface.normal(point)[0] @ X < 0)


WAVE = through(np.array([[0.0, 0.0], [6.0, 3.0], [12.0, -1.0], [18.0, 2.0], [24.0, 0.0]]))


def wavy_bar() -> Part:
    """A bar whose front is a wave, between planes."""
    b = Builder()
    depth, height = 10.0, 8.0
    front = b.face(Extrusion(Z, np.zeros(3), X, WAVE), 1)
    right, back, left = b.face(Plane(X, 24.0)), b.face(Plane(Y, depth)), b.face(Plane(-X, 0.0))
    top, bottom = b.face(Plane(Z, height)), b.face(Plane(-Z, 0.0))
    outline = [(0.0, 0.0), (24.0, 0.0), (24.0, depth), (0.0, depth)]
    walls = [front, right, back, left]
    low, high = ([b.corner(x, y, z) for x, y in outline] for z in (0.0, height))
    lows = [b.chain(along(WAVE, 0.0, 40), front, bottom, low[0], low[1])]
    lows += [b.line(low[k], low[(k + 1) % 4], walls[k], bottom) for k in (1, 2, 3)]
    highs = [b.chain(along(WAVE, height, 40), top, front, high[0], high[1])]
    highs += [b.line(high[k], high[(k + 1) % 4], top, walls[k]) for k in (1, 2, 3)]
    ups = [b.line(low[k], high[k], walls[k - 1], walls[k]) for k in range(4)]
    b.loop(top, *[(k, 1) for k in highs])
    b.loop(bottom, *[(k, -1) for k in lows[::-1]])
    for k in range(4):
        b.loop(walls[k], (lows[k], 1), (ups[(k + 1) % 4], 1), (highs[k], -1), (ups[k], -1))
    return b.part((24.0 * depth - _under(WAVE)) * height, 1000.0)


def _under(profile: Profile) -> float:
    """The area between a profile over x and the x axis."""
    inner = np.unique(profile.knots[3:-3])

    def strip(t: float) -> float:
        at = np.array([t])
        return float(profile.at(at)[0, 1] * profile._curves[1](at)[0, 0])

    return sum(quad(strip, a, b)[0] for a, b in pairwise(inner))


VASE = through(np.array([[5.0, 0.0], [8.0, 5.0], [6.0, 11.0], [4.0, 15.0], [6.5, 20.0]]))


def circle_at(radius: float, height: float) -> Callable[[Array], Array]:
    return lambda t: np.column_stack([radius * np.cos(t), radius * np.sin(t), np.full(len(t), height)])


def vase() -> Part:
    """A solid vase: a profile turned all the way round between two planes."""
    b = Builder()
    wall = b.face(Revolution(Z, np.zeros(3), VASE))
    top, bottom = b.face(Plane(Z, 20.0)), b.face(Plane(-Z, 0.0))
    b.ring(circle_at(6.5, 20.0), top, wall)
    b.ring(circle_at(5.0, 0.0), wall, bottom)
    return b.part(turned_volume(VASE), 1000.0)


DOME = through(np.array([[9.0, 0.0], [8.0, 4.0], [5.5, 6.5], [2.0, 7.6], [0.0, 7.7]]))


def dome() -> Part:
    """A profile that ends on its axis, on a plane."""
    b = Builder()
    cap = b.face(Revolution(Z, np.zeros(3), DOME))
    floor = b.face(Plane(-Z, 0.0))
    b.ring(circle_at(9.0, 0.0), cap, floor)
    return b.part(turned_volume(DOME), 1000.0, box=((-9, -9, 0), (9, 9, 7.7)))


def _section() -> Profile:
    """An ellipse beside the axis."""
    oval = ellipse(4.0, 2.5)
    return Profile(oval.knots, oval.controls + np.array([10.0, 1.0]), True)


def ring() -> Part:
    """An elliptic ring: one face without edges (Pappus)."""
    b = Builder()
    section = _section()
    b.face(Revolution(Z, np.zeros(3), section))
    return b.part(2 * PI * 10.0 * 4.0 * 2.5 * PI, 1000.0, box=((-14, -14, -1.5), (14, 14, 3.5)))


def quarter_ring() -> Part:
    """The quarter of the elliptic ring with x > 0 and y > 0, whose face winds around its section."""
    b = Builder()
    section = _section()
    tube = b.face(Revolution(Z, np.zeros(3), section))
    ends = b.face(Plane(-Y, 0.0)), b.face(Plane(-X, 0.0))
    flat = section.at(np.linspace(*section.ends, 61)[:-1])
    zero = np.zeros(60)
    rings = np.column_stack([flat[:, 0], zero, flat[:, 1]]), np.column_stack([zero, flat[:, 0], flat[:, 1]])[::-1]
    for points, end in zip(rings, ends):
        k = b.chain(points, end, tube)
        b.loop(end, (k, 1))
        b.loop(tube, (k, -1))
    return b.part(PI / 2 * 10.0 * 4.0 * 2.5 * PI, 1000.0, box=((0, 0, -1.5), (14, 14, 3.5)))


def quarter_vase() -> Part:
    """A quarter of the vase, x > 0 and y > 0."""
    b = Builder()
    wall = b.face(Revolution(Z, np.zeros(3), VASE))
    top, bottom = b.face(Plane(Z, 20.0)), b.face(Plane(-Z, 0.0))
    front, left = b.face(Plane(-Y, 0.0)), b.face(Plane(-X, 0.0))
    angles = np.linspace(0, PI / 2, 24)
    flat = VASE.at(np.linspace(*VASE.ends, 40))
    a0, a1 = b.corner(0, 0, 0), b.corner(0, 0, 20)
    x0, x1, y0, y1 = b.corner(5, 0, 0), b.corner(6.5, 0, 20), b.corner(0, 5, 0), b.corner(0, 6.5, 20)
    low = b.chain(circle_at(5.0, 0.0)(angles), wall, bottom, x0, y0)
    high = b.chain(circle_at(6.5, 20.0)(angles), top, wall, x1, y1)
    at_x = b.chain(np.column_stack([flat[:, 0], 0 * flat[:, 0], flat[:, 1]]), front, wall, x0, x1)
    at_y = b.chain(np.column_stack([0 * flat[:, 0], flat[:, 0], flat[:, 1]]), wall, left, y0, y1)
    axis = b.line(a0, a1, left, front)
    spokes = b.line(a0, x0, front, bottom), b.line(a0, y0, bottom, left)
    rays = b.line(a1, x1, top, front), b.line(a1, y1, left, top)
    b.loop(wall, (low, 1), (at_y, 1), (high, -1), (at_x, -1))
    b.loop(top, (high, 1), (rays[1], -1), (rays[0], 1))
    b.loop(bottom, (low, -1), (spokes[0], -1), (spokes[1], 1))
    b.loop(front, (spokes[0], 1), (at_x, 1), (rays[0], -1), (axis, -1))
    b.loop(left, (axis, 1), (rays[1], 1), (at_y, -1), (spokes[1], -1))
    return b.part(turned_volume(VASE) / 4, 1000.0)


SWEPT: dict[str, Callable[[], Part]] = {"tube": tube, "wavy_bar": wavy_bar, "vase": vase, "dome": dome}
SWEPT |= {"ring": ring, "quarter_ring": quarter_ring, "quarter_vase": quarter_vase}
