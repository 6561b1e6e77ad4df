"""The layout of a solid: vertices, edges and faces as flat lists that a CAD kernel only has to transcribe."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.components import components
from sed2cad.geometry.curves import Arc, Array, Circle, Interpolated
from sed2cad.geometry.realise import Realised
from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.scan.scan import Frame

Loop = tuple[tuple[int, int], ...]  # (edge, +1 | -1), the face on the left


@dataclass(frozen=True)
class Pole:
    """A pole of the surface (end of its axis z) inside the face, within one ring of edges."""

    loop: int  # the ring
    vertex: int  # its vertex on the seam
    up: bool  # whether it is the pole towards which z points


@dataclass(frozen=True)
class Placement:
    """Where a surface has its origin, its axis z and the half-plane x of its seam."""

    origin: Array  # (3,)
    z: Array  # (3,), unit
    x: Array  # (3,), unit, across z
    pole: Pole | None = None
    seam: float = 0.0  # of a closed control net: where in its period it is cut, 0 .. 1


@dataclass(frozen=True)
class LayoutEdge:
    """A piece of curve between two vertices (the same vertex twice where it is closed)."""

    arc: Arc
    start: int  # vertex; -1 while a closed edge has not been given its start
    end: int
    residual: float  # largest distance from its surfaces
    chain: int


@dataclass(frozen=True)
class LayoutFace:
    """A trimmed surface; without loops the whole closed surface."""

    region: int
    primitive: Primitive
    sign: int  # +1 when the outward normal is the primitive's
    placement: Placement
    loops: tuple[Loop, ...]
    points: Array  # (m, 3) spread over the face
    body: int


@dataclass(frozen=True)
class Layout:
    """All of it, in one unit and frame."""

    vertices: Array  # (v, 3)
    edges: tuple[LayoutEdge, ...]
    faces: tuple[LayoutFace, ...]
    open_bodies: frozenset[int] = frozenset()  # some of whose faces were left out

    def in_world(self, frame: Frame) -> Layout:
        """From the unit frame to world coordinates."""
        scale, origin = frame.scale, frame.origin
        edges = tuple(replace(e, arc=e.arc.scaled(scale, origin), residual=scale * e.residual) for e in self.edges)
        faces = tuple(
            replace(
                f,
                primitive=f.primitive.scaled(scale, origin),
                points=scale * f.points + origin,
                placement=replace(f.placement, origin=scale * f.placement.origin + origin),
            )
            for f in self.faces
        )
        return Layout(scale * self.vertices + origin, edges, faces, self.open_bodies)

    def without(self, left_out: Collection[int]) -> Layout:
        """The layout without the faces of some regions: what hangs together of the rest is a body."""
        faces = [face for face in self.faces if face.region not in left_out]
        if len(faces) == len(self.faces):
            return self
        uses = [(n, e) for n, face in enumerate(faces) for loop in face.loops for e, _ in loop]
        face, edge = np.array(uses, dtype=np.int64).reshape(-1, 2).T
        _, part = components(len(faces) + len(self.edges), np.column_stack([face, len(faces) + edge]))
        alone = np.bincount(edge, minlength=len(self.edges)) == 1
        faces = [replace(f, body=int(own)) for f, own in zip(faces, part)]
        return replace(self, faces=tuple(faces), open_bodies=frozenset(part[face[alone[edge]]].tolist()))


class Draft:
    """A layout in the making: edges can be started and cut while the seams are placed."""

    def __init__(self, realised: Realised, fitted: Sequence[FittedPatch]) -> None:
        topology = realised.topology
        self.topology = topology
        self.fitted = fitted
        self.vertices: list[Array] = list(realised.corners)
        self.edges: list[LayoutEdge] = []
        edge_of: dict[int, int] = {}
        for k, (chain, edge) in enumerate(zip(topology.chains, realised.edges)):
            if edge is not None:
                start, end = (-1 if c < 0 else int(realised.clusters[c]) for c in (chain.start, chain.end))
                edge_of[k] = len(self.edges)
                self.edges.append(LayoutEdge(edge.arc, start, end, edge.residual, k))
        self.loops = [
            [[(edge_of[k], way) for k, way in loop if k in edge_of] for loop in region.loops]
            for region in topology.regions
        ]
        self.gone: set[int] = set()
        self.drop_empty()

    def primitive(self, region: int) -> Primitive:
        """The surface of a region."""
        return self.fitted[self.topology.regions[region].primitive].primitive

    @property
    def regions(self) -> list[int]:
        """Those that have a face."""
        return [r for r in range(len(self.topology.regions)) if r not in self.gone]

    def drop_empty(self) -> None:
        """Leave out loops without edges, and the regions that are left without any."""
        for region, loops in enumerate(self.loops):
            loops[:] = [loop for loop in loops if loop]
            if not loops and self.topology.regions[region].loops:
                self.gone.add(region)

    def unite(self, one: int, two: int) -> None:
        """Let edges end at one vertex instead of another at the same place."""
        for number, edge in enumerate(self.edges):
            start, end = (one if vertex == two else vertex for vertex in (edge.start, edge.end))
            self.edges[number] = replace(edge, start=start, end=end)

    def edge_samples(self, edge: int) -> Array:
        """Points (n, 3) along an edge, both ends included."""
        arc = self.edges[edge].arc
        count = len(arc.curve.points) * 2 if isinstance(arc.curve, Interpolated) else 48
        return arc.sampled(count + 1)

    def loop_samples(self, loop: Sequence[tuple[int, int]]) -> Array:
        """Points (n, 3) around a loop; the last repeats the first."""
        return np.vstack([self.edge_samples(e)[::way] for e, way in loop])

    def start_closed(self, edge: int, parameter: float) -> None:
        """Give a closed edge its vertex, at `parameter`."""
        old = self.edges[edge]
        arc = _restarted(old.arc, parameter)
        self.vertices.append(arc.ends()[0])
        vertex = len(self.vertices) - 1
        self.edges[edge] = replace(old, arc=arc, start=vertex, end=vertex)

    def cut(self, edge: int, parameter: float) -> int:
        """Cut an edge in two at `parameter`; the new vertex."""
        old = self.edges[edge]
        self.vertices.append(old.arc.curve.at(np.array([parameter]))[0])
        vertex, second = len(self.vertices) - 1, len(self.edges)
        self.edges[edge] = replace(old, arc=replace(old.arc, last=parameter), end=vertex)
        self.edges.append(replace(old, arc=replace(old.arc, first=parameter), start=vertex))
        for loops in self.loops:
            for loop in loops:
                for place in [k for k, (e, _) in enumerate(loop) if e == edge][::-1]:
                    way = loop[place][1]
                    loop[place : place + 1] = [(edge, way), (second, way)][::way]
        return vertex

    def finished(self, placements: Mapping[int, Placement]) -> Layout:
        """The layout; closed edges that no seam asked for start where their arcs do."""
        for edge, old in enumerate(self.edges):
            if old.start < 0:
                self.start_closed(edge, old.arc.first)
        faces = tuple(
            LayoutFace(
                r,
                self.primitive(r),
                self.fitted[self.topology.regions[r].primitive].sign,
                placements[r],
                tuple(tuple(loop) for loop in self.loops[r]),
                self.topology.regions[r].points,
                self.topology.regions[r].body,
            )
            for r in self.regions
        )
        return Layout(np.array(self.vertices).reshape(-1, 3), tuple(self.edges), faces)


def _restarted(arc: Arc, parameter: float) -> Arc:
    """A closed arc that starts and ends at `parameter`."""
    curve = arc.curve
    if isinstance(curve, Circle):
        return Arc(curve.started_at(parameter), 0.0, 2 * np.pi)
    if not isinstance(curve, Interpolated):
        first = parameter % (2 * np.pi)
        return Arc(curve, first, first + 2 * np.pi)
    at = parameter % curve.length
    start = curve.at(np.array([at]))
    knots = curve.knots[:-1]
    step = curve.length / len(knots)
    apart = np.abs((knots - at + curve.length / 2) % curve.length - curve.length / 2)
    after = np.argsort((knots - at) % curve.length)
    after = after[apart[after] > 0.4 * min(step, curve.length / 8)]
    turned = Interpolated(np.vstack([start, curve.points[after]]), True)
    return Arc(turned, 0.0, turned.length)
