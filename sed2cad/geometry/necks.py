"""Necks of faces that have no width: an edge that runs through a corner on the face's other side, as the circle of a
chamfer runs through the corners of a hexagonal socket. The mesh shows a way past the corner; there is none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sed2cad.geometry.contact import Side
from sed2cad.geometry.corners import solve_corner
from sed2cad.geometry.meeting import meetings_of
from sed2cad.geometry.web import Web
from sed2cad.primitives.base import FittedPatch
from sed2cad.topology.model import Topology

_NARROW = 0.015  # unit frame: a mesh shows no wider necks where there are none
_TOUCHING = 2e-4  # unit frame: so nearly does an edge run through a corner
_FAR = 0.03  # unit frame: the corner lies this near to where the mesh has it


def without_necks(topology: Topology, fitted: Sequence[FittedPatch]) -> Topology:
    """The topology with faces cut in two where they have no width; the parts behind necks are its last regions."""
    sides = [Side.of(patch) for patch in fitted]
    smooth = {k for k, how in enumerate(meetings_of(topology, sides)) if how != "crossing"}
    web, region = Web(topology), 0
    while region < len(web.loops):
        found = next(_necks(web, region, fitted, smooth), None)
        if found is None:
            region += 1
        else:
            web = web.pinched(*found, region)
    return web.topology()


def _necks(web: Web, region: int, fitted: Sequence[FittedPatch], smooth: set[int]) -> Iterator[tuple[int, int]]:
    """Chains of a region with the corners on its other side that they run through."""
    chains = [k for loop in web.loops[region] for k, _ in loop]
    corners = {c for k in chains if not web.chains[k].closed for c in (web.chains[k].start, web.chains[k].end)}
    for k in (k for k in chains if k not in smooth and web.beside(k, region) != region):
        for corner in sorted(corners - {web.chains[k].start, web.chains[k].end}):
            if _runs_by(web, k, corner) and web.can_pinch(k, corner, region):
                if _runs_through(web, k, corner, region, fitted, smooth):
                    yield k, corner


def _runs_by(web: Web, k: int, corner: int) -> bool:
    """Whether a chain comes near to a corner, but not with its ends."""
    chain, at = web.chains[k], web.corners[corner]
    apart = np.linalg.norm(chain.points - at, axis=1)
    ends = np.inf if chain.closed else apart[[0, -1]].min()
    return bool(apart.min() < _NARROW < ends)


def _runs_through(
    web: Web, k: int, corner: int, region: int, fitted: Sequence[FittedPatch], smooth: set[int]
) -> bool:
    """Whether the surface beyond a chain of a region goes through one of its corners, where surfaces cross, as far as
    noise lets it be told."""
    turn, far = web.turn(corner), web.beside(k, region)
    around = [other for _, other in turn]
    if around.count(region) != 1 or far in around or any(ray[0] in smooth for ray, _ in turn):
        return False
    numbers = list(dict.fromkeys(web.primitive(other) for other in [*around, far]))
    solved = solve_corner(web.corners[corner], [Side.of(fitted[n]) for n in numbers], [])
    return solved.residual < max(_TOUCHING, *(fitted[n].rms for n in numbers)) and solved.moved < _FAR
