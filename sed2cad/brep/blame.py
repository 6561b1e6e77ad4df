"""Which faces keep a solid from passing the gate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepCheck import BRepCheck_Analyzer
from scipy.spatial import cKDTree

from sed2cad.brep.attempt import Limits
from sed2cad.brep.bodies import Joined
from sed2cad.brep.gate import Checked
from sed2cad.brep.kernel import edges, faces, numbers, vertices
from sed2cad.brep.measure import Deviations, Triangles, nearest_triangles, spread_over
from sed2cad.geometry.facets import is_loose
from sed2cad.geometry.layout import Layout
from sed2cad.scan.scan import Frame
from sed2cad.topology.model import Topology

_SAMPLES = 20_000  # points on the solid
_MISSING = 0.1  # share of a region's points that its face may miss
_OFF = 0.3  # of the largest tolerance: edges this far from their surfaces may be the cause of it all
_BEYOND = 0.1  # share of a face that may lie off its region


def to_blame(
    joined: Joined, checked: Checked, topology: Topology, left_out: Collection[int], frame: Frame, limits: Limits
) -> tuple[int, ...]:
    """The regions whose faces are lost, invalid, not to be drawn, changed by the STEP file, too far from their edges or
    off the scan: what is behind the gate's first fault, if that is known. What was left out is not lost.

    () where none stands out.
    """
    lost = set(range(len(topology.regions))) - set(joined.regions) - set(left_out)
    found = checked.result
    if not (found.closed or joined.is_open) or not found.valid or lost:
        return tuple(sorted(lost | _invalid(joined)))
    if numbers := checked.undrawn or checked.changed:
        return tuple(sorted({joined.regions[number] for number in numbers} - {-1}))
    wide = _off_edges(joined, topology, limits.tolerance * frame.scale)
    astray = found.coverage < limits.coverage or found.stray > limits.stray * frame.scale
    if (wide and not astray) or checked.deviations is None:
        return wide
    return tuple(sorted(_astray(joined, checked.deviations, topology, frame, limits))) or wide


def _invalid(joined: Joined) -> set[int]:
    """Regions of faces that the kernel rejects."""
    check = BRepCheck_Analyzer(joined.shape)
    wrong = (r for face, r in zip(faces(joined.shape), joined.regions) if not check.IsValid(face))
    return {r for r in wrong if r >= 0}


def _astray(
    joined: Joined, deviations: Deviations, topology: Topology, frame: Frame, limits: Limits
) -> set[int]:
    """Regions whose face leaves some of their points alone, or reaches beyond them."""
    mesh, reach = deviations.mesh, limits.distance * frame.scale
    spread, owner = spread_over(mesh, _SAMPLES)
    region_of = np.array(joined.regions)
    found = set()
    for r, region in enumerate(topology.regions):
        own = np.flatnonzero(np.isin(mesh.owner, np.flatnonzero(region_of == r)))
        if len(own) == 0 or len(region.points) == 0:
            continue
        points = frame.to_world(region.points)
        off, _ = nearest_triangles(points, Triangles(mesh.vertices, mesh.triangles[own], mesh.owner[own]))
        width = 1.5 * np.sqrt(region.area / len(points)) * frame.scale
        beyond, _ = cKDTree(points).query(spread[np.isin(owner, own)].reshape(-1, 3))
        if (off > reach).mean() > _MISSING or (beyond > reach + width).sum() > _BEYOND * len(beyond):
            found.add(r)
    return found


def _off_edges(joined: Joined, topology: Topology, limit: float) -> tuple[int, ...]:
    """The fewest exact regions, small ones rather, that all edges lie on which are too far from their faces; where only
    vertices are, those that all of these lie on."""
    cut = {r for r in joined.regions if joined.regions.count(r) > 1}
    owned = [(face, r) for face, r in zip(faces(joined.shape), joined.regions) if r >= 0 and r not in cut]
    for parts in (edges, vertices):
        every = parts(joined.shape)
        far = {k for k, part in enumerate(every) if BRep_Tool.Tolerance_s(part) > limit}
        sides = [(part, r) for face, r in owned for part in parts(face)] if far else []
        beside: dict[int, set[int]] = {}
        for k, (_, region) in zip(numbers(every, [part for part, _ in sides]), sides):
            if k in far:
                beside.setdefault(k, set()).add(region)
        if beside:
            return _cover(list(beside.values()), topology)
    return ()


def _cover(sets: list[set[int]], topology: Topology) -> tuple[int, ...]:
    """Regions of which each set has one: always that which most sets have, the smallest of several."""
    found = []
    while sets:
        shared = Counter(region for own in sets for region in own)
        found.append(max(shared, key=lambda region: (shared[region], -topology.regions[region].area)))
        sets = [own for own in sets if found[-1] not in own]
    return tuple(sorted(found))


def at_worst_edge(layout: Layout, topology: Topology, limit: float) -> tuple[int, ...]:
    """The smaller region at the edge that is farthest from its surfaces, where that is far (unit frame)."""
    beside: dict[int, set[int]] = {}
    for face in layout.faces:
        for loop in face.loops:
            for edge, _ in loop:
                if not is_loose(face):
                    beside.setdefault(edge, set()).add(face.region)
    if not beside:
        return ()
    worst = max(beside, key=lambda e: layout.edges[e].residual)
    if layout.edges[worst].residual < _OFF * limit:
        return ()
    return (min(beside[worst], key=lambda r: topology.regions[r].area),)
