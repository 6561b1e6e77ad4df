"""Faces without a surface become triangles on the edges that they share with their neighbours.

The edges keep their curves; they are cut where a straight side would leave them, and their tolerance covers
what is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sed2cad.geometry.bulges import bulged
from sed2cad.geometry.curves import Arc, Array, Line
from sed2cad.geometry.layout import Layout, LayoutEdge, LayoutFace, Loop, Placement
from sed2cad.geometry.polygons import MOST_CORNERS, Cloud, filled
from sed2cad.primitives.loose import Loose
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.vectors import tangent_frame, unit

_SAGITTA = (0.0015, 0.003, 0.006)  # unit frame: how far a side may leave its curve; the coarser for many corners
_MOST_CUTS = 48  # of one edge
_STRAIGHT = 1e-6  # unit frame


def is_loose(face: LayoutFace) -> bool:
    """Whether a face waits for its facets."""
    return isinstance(face.primitive, Loose)


def faceted(layout: Layout, clouds: Mapping[int, Cloud]) -> Layout:
    """The layout (unit frame) with triangles for its loose faces; clouds by region.

    AssemblyError where a face cannot be cut into triangles.
    """
    loose = [n for n, face in enumerate(layout.faces) if is_loose(face)]
    if not loose:
        return layout
    for sagitta in _SAGITTA:
        work = _cut_edges(layout, sagitta)
        if max(sum(map(len, work.loops[n])) for n in loose) <= MOST_CORNERS - 10:
            break
    faces = [replace(f, loops=tuple(work.loops[n])) for n, f in enumerate(layout.faces) if n not in loose]
    for n in loose:
        faces += work.triangles(layout.faces[n], work.loops[n], clouds[layout.faces[n].region])
    return replace(layout, vertices=np.array(work.vertices), edges=tuple(work.edges), faces=tuple(faces))


@dataclass
class _Work:
    """A layout in pieces."""

    vertices: list[Array]
    edges: list[LayoutEdge] = field(default_factory=list)
    loops: list[list[Loop]] = field(default_factory=list)

    def triangles(self, face: LayoutFace, loops: Sequence[Loop], cloud: Cloud) -> list[LayoutFace]:
        """The facets of one face."""
        steps = [step for loop in loops for step in loop]
        named = iter(range(len(steps)))
        corners = [[(self._origin(step), next(named)) for step in loop] for loop in loops]
        polygon = filled(corners, np.array(self.vertices), cloud)
        bulged(polygon, cloud)
        first = len(self.vertices)
        own = [v for v, _ in polygon.corners]
        own += [first + k for k in range(len(polygon.points) - len(own))]
        self.vertices += polygon.points[len(polygon.corners) :]
        sides: dict[tuple[int, int], tuple[int, int]] = {}
        bridges: dict[int, int] = {}
        for k, (_, name) in enumerate(polygon.corners):
            after = (k + 1) % len(polygon.corners)
            if name >= 0:
                sides[k, after] = steps[name]
            elif name in bridges:
                sides[k, after] = bridges[name], -1
            else:
                bridges[name] = self._straight(own[k], own[after])
                sides[k, after] = bridges[name], 1
        return [self._facet(face, triangle, own, sides) for triangle in polygon.triangles]

    def _facet(
        self,
        face: LayoutFace,
        triangle: tuple[int, int, int],
        own: Sequence[int],
        sides: dict[tuple[int, int], tuple[int, int]],
    ) -> LayoutFace:
        """One triangle; its inner sides are made when they are first met."""
        loop = []
        for a, b in zip(triangle, (triangle[1], triangle[2], triangle[0])):
            if (a, b) not in sides:
                edge = self._straight(own[a], own[b])
                sides[a, b], sides[b, a] = (edge, 1), (edge, -1)
            loop.append(sides[a, b])
        corners = np.array([self.vertices[own[k]] for k in triangle])
        normal = unit(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        centre = corners.mean(axis=0)
        placement = Placement(centre, normal, tangent_frame(normal)[0])
        plane = Plane(normal, float(normal @ centre))
        return replace(
            face, primitive=plane, sign=1, placement=placement, loops=(tuple(loop),), points=centre[None]
        )

    def _straight(self, start: int, end: int) -> int:
        """A new straight edge."""
        self.edges.append(LayoutEdge(chord(self.vertices[start], self.vertices[end]), start, end, 0.0, -1))
        return len(self.edges) - 1

    def _origin(self, step: tuple[int, int]) -> int:
        edge = self.edges[step[0]]
        return edge.start if step[1] > 0 else edge.end


def chord(start: Array, end: Array) -> Arc:
    """The straight arc between two points (3,)."""
    length = float(np.linalg.norm(end - start))
    return Arc(Line(start, (end - start) / max(length, 1e-300)), 0.0, length)


def _cut_edges(layout: Layout, sagitta: float) -> _Work:
    """The edges of loose faces cut so that straight sides stay within `sagitta` of them."""
    sides: dict[int, list[bool]] = {}
    least: dict[int, int] = {}
    for face in layout.faces:
        for loop in face.loops:
            for e, _ in loop:
                sides.setdefault(e, []).append(is_loose(face))
                if is_loose(face):
                    least[e] = max(least.get(e, 1), {1: 4, 2: 2}.get(len(loop), 1))
    work = _Work(list(layout.vertices))
    pieces: dict[int, list[int]] = {}
    for e, edge in enumerate(layout.edges):
        if any(sides.get(e, ())):
            count = 1 if isinstance(edge.arc.curve, Line) and least[e] == 1 else _count(edge, sagitta, least[e])
            cut = _pieces(work, edge, count, all(sides[e]))
        else:
            cut = [edge]
        pieces[e] = list(range(len(work.edges), len(work.edges) + len(cut)))
        work.edges += cut
    for face in layout.faces:
        work.loops.append(
            [tuple((piece, way) for e, way in loop for piece in pieces[e][::way]) for loop in face.loops]
        )
    return work


def _count(edge: LayoutEdge, sagitta: float, least: int) -> int:
    """Into how many pieces an edge is to be cut."""
    if isinstance(edge.arc.curve, Line):
        return least
    for count in range(least, _MOST_CUTS):
        points = edge.arc.sampled(8 * count + 1)
        if _off_chords(points, 8).max() < sagitta:
            return count
    return _MOST_CUTS


def _off_chords(points: Array, each: int) -> Array:
    """How far the chords over `each` steps of a line of points lie from it, at most (pieces,)."""
    starts, ends = points[:-1:each], points[each::each]
    share = np.linspace(0, 1, each + 1)[None, :, None]
    straight = (1 - share) * starts[:, None] + share * ends[:, None]
    rows = np.arange(len(starts))[:, None] * each + np.arange(each + 1)
    return np.linalg.norm(straight - points[rows], axis=2).max(axis=1)


def _pieces(work: _Work, edge: LayoutEdge, count: int, alone: bool) -> list[LayoutEdge]:
    """The pieces of an edge at even parameters; straight ones where no exact face needs the curve."""
    at = np.linspace(edge.arc.first, edge.arc.last, count + 1)
    ends = [edge.start, *range(len(work.vertices), len(work.vertices) + count - 1), edge.end]
    work.vertices += list(edge.arc.curve.at(at[1:-1]))
    off = _off_chords(edge.arc.sampled(8 * count + 1), 8)
    found = []
    for k, sag in enumerate(off):
        start, end = ends[k], ends[k + 1]
        if alone or sag < _STRAIGHT:
            arc = chord(work.vertices[start], work.vertices[end])
            residual = 0.0 if alone else edge.residual + float(sag)
        else:
            arc = replace(edge.arc, first=float(at[k]), last=float(at[k + 1]))
            residual = max(edge.residual, float(sag))
        found.append(replace(edge, arc=arc, start=start, end=end, residual=residual))
    return found
