"""From labelled triangles to the topology: loops by walking half-edges, cut into chains at the corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.scan import Array, Mesh
from sed2cad.topology.manifold import bodies, following, twins
from sed2cad.topology.mincut import Labels
from sed2cad.topology.model import Chain, Region, Topology

_SMOOTHED = 12  # chains with fewer points stay as they are
_PASSES = 3
_REGION_POINTS = 200

Walk = list[int]  # half-edges in order
Loop = tuple[tuple[int, int], ...]  # (chain, +1 | -1)


@dataclass(frozen=True)
class Border:
    """The half-edges between regions."""

    mesh: Mesh
    region: Labels  # (f,)
    twin: Labels  # (3 f,)
    halves: Labels  # (b,) half-edges whose twin is in another region
    after: dict[int, int]  # from each of them to the next around its region
    corners: NDArray[np.bool_]  # (v,) vertices where three or more regions meet

    def origin(self, half: int) -> int:
        return int(self.mesh.faces[half // 3, half % 3])

    def at_corner(self, half: int) -> bool:
        """Whether the half-edge starts at a corner."""
        return bool(self.corners[self.origin(half)])


def border_of(mesh: Mesh, region: Labels) -> Border:
    """The border between the regions (f,) of a closed manifold mesh."""
    twin = twins(mesh.faces)
    side = np.repeat(region, 3)
    on_border = side != side[twin]
    halves = np.flatnonzero(on_border)
    after = following(halves)
    while not on_border[after].all():
        inner = ~on_border[after]
        after[inner] = following(twin[after[inner]])
    degree = np.bincount(mesh.faces.ravel()[halves], minlength=len(mesh.vertices))
    return Border(mesh, region, twin, halves, dict(zip(halves.tolist(), after.tolist())), degree > 2)


def cycles(border: Border) -> list[Walk]:
    """The loops around the regions, each with its region on the left; started at a corner if there is one."""
    seen: set[int] = set()
    found = []
    for first in border.halves.tolist():
        if first in seen:
            continue
        walk = [first]
        while (following_half := border.after[walk[-1]]) != first:
            walk.append(following_half)
        seen.update(walk)
        start = next((k for k, half in enumerate(walk) if border.at_corner(half)), 0)
        found.append(walk[start:] + walk[:start])
    return found


def pieces(border: Border, cycle: Walk) -> list[Walk]:
    """The cycle cut at the corners."""
    cuts = [k for k, half in enumerate(cycle) if border.at_corner(half)] or [0]
    return [cycle[a:b] for a, b in zip(cuts, [*cuts[1:], len(cycle)])]


def build_topology(mesh: Mesh, region: Labels, primitives: Labels) -> Topology:
    """The topology of the regions (f,) of a closed manifold mesh; primitives (r,) carry the regions."""
    border = border_of(mesh, region)
    number = np.cumsum(border.corners) - 1  # of each corner vertex
    chains: list[Chain] = []
    known: dict[int, tuple[int, int]] = {}  # first half-edge of a piece to (chain, direction)
    loops: list[list[Loop]] = [[] for _ in primitives]
    for cycle in cycles(border):
        loop = []
        for piece in pieces(border, cycle):
            key = _key(border, piece)
            if key not in known:
                chains.append(_chain(border, piece, number))
                known[key] = (len(chains) - 1, 1)
                known[_key(border, _reverse(border, piece))] = (len(chains) - 1, -1)
            loop.append(known[key])
        loops[int(region[cycle[0] // 3])].append(tuple(loop))
    regions = _regions(mesh, region, primitives, loops)
    return Topology(regions, tuple(chains), mesh.vertices[border.corners], mesh.volume())


def _reverse(border: Border, piece: Walk) -> Walk:
    """The same piece as the region on its other side walks it."""
    return [int(border.twin[half]) for half in reversed(piece)]


def _key(border: Border, piece: Walk) -> int:
    """What names a piece: its first half-edge; the least one of a whole cycle, which starts anywhere."""
    return piece[0] if border.at_corner(piece[0]) else min(piece)


def _chain(border: Border, piece: Walk, number: Labels) -> Chain:
    """The chain of a piece, its left region the one that walks it."""
    left = int(border.region[piece[0] // 3])
    right = int(border.region[border.twin[piece[0]] // 3])
    vertices = [border.origin(half) for half in piece]
    if not border.at_corner(piece[0]):
        return Chain(_smoothed(border.mesh.vertices[vertices], True), left, right, -1, -1)
    vertices.append(border.origin(int(border.twin[piece[-1]])))
    points = _smoothed(border.mesh.vertices[vertices], False)
    return Chain(points, left, right, int(number[vertices[0]]), int(number[vertices[-1]]))


def _smoothed(points: Array, closed: bool) -> Array:
    """Points (n, 3) without the zigzag of the triangles; the ends of an open chain stay."""
    if len(points) < _SMOOTHED:
        return points
    for _ in range(_PASSES):
        mean = 0.5 * points + 0.25 * (np.roll(points, 1, axis=0) + np.roll(points, -1, axis=0))
        points = mean if closed else np.vstack([points[:1], mean[1:-1], points[-1:]])
    return points


def _regions(mesh: Mesh, region: Labels, primitives: Labels, loops: list[list[Loop]]) -> tuple[Region, ...]:
    """One region for each entry of primitives (r,)."""
    centres, (_, areas) = mesh.centroids(), mesh.face_normals()
    _, body = bodies(mesh.faces)
    order = np.argsort(region, kind="stable")
    members = np.split(order, np.searchsorted(region[order], np.arange(1, len(primitives))))
    found = []
    for which, at in enumerate(members):
        spread = at[np.linspace(0, len(at) - 1, min(len(at), _REGION_POINTS)).astype(np.int64)]
        area, home = float(areas[at].sum()), int(body[at[0]])
        found.append(Region(int(primitives[which]), tuple(loops[which]), centres[spread], area, home))
    return tuple(found)
