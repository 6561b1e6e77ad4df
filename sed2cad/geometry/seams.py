"""Where the surfaces of the faces have their axes, poles and seams.

A CAD kernel cuts a surface that closes on itself along a seam. A face that does not go all the way round
keeps the seam in its gap; one that does needs a vertex on the seam in every loop that winds around, so
closed edges start there and others are cut there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from sed2cad.errors import AssemblyError
from sed2cad.geometry.curves import TURN, Array, Curve, winding
from sed2cad.geometry.layout import Draft, Layout, Placement, Pole
from sed2cad.geometry.turning import Turning, share_of, wrapped
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.loose import Loose
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import about_axis, tangent_frame

_HIT = 1e-7  # radians: a vertex this near to the seam is on it
_MISS = 0.03  # radians: a vertex that is not on the seam keeps this far from it
_TRIED = 36  # seam directions tried beside those of vertices


class OpenFace(AssemblyError):
    """Faces that wind around their axes and do not come back."""

    def __init__(self, regions: tuple[int, ...], sentence: str) -> None:
        super().__init__(sentence)
        self.regions = regions


def place(draft: Draft) -> Layout:
    """Place every surface; start and cut the edges that wind around one.

    OpenFace with all faces that wind around their axes and are open on one side.
    """
    turning = {r: Turning.of(draft, r) for r in draft.regions}
    placements: dict[int, Placement] = {}
    open_: list[OpenFace] = []
    # the seam along the tube of a torus cannot be chosen: those faces come first
    for r in sorted(turning, key=lambda r: (not _tube_winds(draft, r), r)):
        turned = turning[r]
        try:
            placements[r] = _flat(draft, r) if turned is None else _turned(draft, r, turned)
        except OpenFace as error:
            open_.append(error)
    if open_:
        raise OpenFace(tuple(r for error in open_ for r in error.regions), str(open_[0]))
    return draft.finished(placements)


def _flat(draft: Draft, region: int) -> Placement:
    """The frame of a face without a seam."""
    points = draft.topology.regions[region].points
    centre = points.mean(axis=0) if len(points) else np.zeros(3)
    primitive = draft.primitive(region)
    if isinstance(primitive, BSplineSurface):
        return Placement(primitive.origin, primitive.frame[2], primitive.frame[0])
    if isinstance(primitive, Extrusion):
        return Placement(primitive.origin, primitive.direction, primitive.x_axis)
    if isinstance(primitive, (Loose, NetSurface)):
        return Placement(centre, np.eye(3)[2], np.eye(3)[0])
    assert isinstance(primitive, Plane)
    normal = primitive.normal_vector
    return Placement(primitive.project(centre[None])[0], normal, tangent_frame(normal)[0])


def _turned(draft: Draft, region: int, turning: Turning) -> Placement:
    """Choose the seam of a face on a surface that closes on itself and bring its edges to it."""
    loops = draft.loops[region]
    samples = [draft.loop_samples(loop) for loop in loops]
    turns = [winding(turning.angles(s)) for s in samples]
    rings = [k for k, turn in enumerate(turns) if turn]
    others = [s for k, s in enumerate(samples) if k not in rings]
    if rings:
        angle = _seam_through(draft, [loops[k] for k in rings], others, turning)
    else:
        angle = _gap([turning.angles(s) for s in [*others, draft.topology.regions[region].points]])
    seamed = turning.turned(angle)
    for k in rings:
        _bring_to_zero(draft, region, k, seamed.angles)
    around_tube = _tube(draft.primitive(region))
    if around_tube is not None:
        for k, s in enumerate(samples):
            if winding(around_tube(s)):
                _bring_to_zero(draft, region, k, around_tube)
    return seamed.placement(_origin(draft, region, seamed), _pole(draft, region, seamed, turns))


def _pole(draft: Draft, region: int, turning: Turning, turns: Sequence[int]) -> Pole | None:
    """The pole inside a face, told by its rings not cancelling out.

    OpenFace where there is no pole to close the face.
    """
    if sum(turns) == 0:
        return None
    primitive = draft.primitive(region)
    up = sum(turns) * draft.fitted[draft.topology.regions[region].primitive].sign > 0
    if not _has_pole(primitive, up):
        raise OpenFace((region,), f"a {primitive.kind} face is open on one side: the face that closes it is missing")
    rings = [k for k, turn in enumerate(turns) if turn]
    if len(rings) > 1:
        return None
    ends = sorted({v for e, _ in draft.loops[region][rings[0]] for v in (draft.edges[e].start, draft.edges[e].end)})
    off = np.abs(turning.angles(np.array([draft.vertices[v] for v in ends])))
    return Pole(rings[0], ends[int(off.argmin())], up)


def _has_pole(primitive: Primitive, up: bool) -> bool:
    """Whether the surface comes together at that end."""
    if isinstance(primitive, Revolution):
        return primitive.poles()[int(up)]
    return isinstance(primitive, Sphere) or (isinstance(primitive, Cone) and not up)


def _origin(draft: Draft, region: int, turning: Turning) -> Array:
    """The origin of the surface: amid the face where the axis leaves it open."""
    primitive = draft.primitive(region)
    if not isinstance(primitive, (Cylinder, Cone)):
        return turning.origin
    points = np.vstack([draft.topology.regions[region].points, *map(draft.loop_samples, draft.loops[region])])
    heights = about_axis(points, turning.origin, turning.z)[0]
    return turning.origin + 0.5 * float(heights.min() + heights.max()) * turning.z


def _tube(primitive: Primitive) -> Callable[[Array], Array] | None:
    """Angles (n,) of points (n, 3) around the tube of a ring: from its outer equator, or where its profile begins."""
    if isinstance(primitive, Torus):
        torus = primitive

        def around_circle(points: Array) -> Array:
            height, radius, _ = about_axis(points, torus.centre, torus.axis)
            return np.arctan2(height, radius - torus.major_radius)

        return around_circle
    if isinstance(primitive, Revolution) and primitive.profile.closed:
        ring = primitive
        return lambda points: wrapped(share_of(ring.profile, ring.meridian(points)))
    return None


def _tube_winds(draft: Draft, region: int) -> bool:
    around_tube = _tube(draft.primitive(region))
    return around_tube is not None and any(
        winding(around_tube(draft.loop_samples(loop))) for loop in draft.loops[region]
    )


def _gap(angles: Sequence[Array]) -> float:
    """The middle of the largest gap between angles; 0 where there is none."""
    every = np.sort(np.concatenate(angles)) if angles else np.zeros(0)
    if len(every) == 0:
        return 0.0
    gaps = np.diff(np.append(every, every[0] + TURN))
    k = int(gaps.argmax())
    return float(every[k] + gaps[k] / 2) if gaps[k] > 0.05 else 0.0


def _seam_through(
    draft: Draft, loops: Sequence[Sequence[tuple[int, int]]], others: Sequence[Array], turning: Turning
) -> float:
    """The angle for the seam of a face that winds around: through a vertex of each loop, past the other loops, and not
    along an edge, as it is where there are two vertices of one."""
    fixed = [{v for e, _ in loop for v in (draft.edges[e].start, draft.edges[e].end)} - {-1} for loop in loops]
    rings = [turning.angles(np.array([draft.vertices[v] for v in sorted(own)]).reshape(-1, 3)) for own in fixed]
    at = np.concatenate(rings)
    ranges = [np.unwrap(turning.angles(s)) for s in others]
    candidates = np.concatenate([[0.0], at, np.linspace(0, TURN, _TRIED, endpoint=False)])

    def score(angle: float) -> float:
        off = np.abs(wrapped(at - angle))
        near = int(((off >= _HIT) & (off < _MISS)).sum())
        hits = [int((np.abs(wrapped(ring - angle)) < _HIT).sum()) for ring in rings]
        along = sum(count > 1 for count in hits)
        covered = sum(bool(abs(wrapped(angle - r.mean())) < np.ptp(r) / 2 + _MISS) for r in ranges)
        return 10 * hits.count(1) - 25 * near - 100 * (covered + along) + (1 if angle == 0 else 0)

    return float(max(candidates, key=score))


def _bring_to_zero(draft: Draft, region: int, k: int, angles: Callable[[Array], Array]) -> None:
    """Give loop k of a region a vertex where `angles` of its points is 0."""
    loop = draft.loops[region][k]
    ends = [v for e, _ in loop for v in (draft.edges[e].start, draft.edges[e].end) if v >= 0]
    if ends and np.abs(angles(np.array([draft.vertices[v] for v in ends]))).min() < 10 * _HIT:
        return
    for edge, _ in loop:
        arc = draft.edges[edge].arc
        at = np.linspace(arc.first, arc.last, 97)
        values = angles(arc.curve.at(at))
        crossing = np.flatnonzero((values[:-1] * values[1:] <= 0) & (np.abs(values[:-1] - values[1:]) < np.pi))
        if len(crossing):
            found = _root(arc.curve, angles, at[crossing[0]], at[crossing[0] + 1])
            if draft.edges[edge].start < 0:
                draft.start_closed(edge, found)
            else:
                draft.cut(edge, found)
            return


def _root(curve: Curve, angles: Callable[[Array], Array], low: float, high: float) -> float:
    """The parameter between low and high where `angles` of the curve's point is 0."""
    return float(brentq(lambda t: float(angles(curve.at(np.array([t])))[0]), low, high, xtol=1e-14))
