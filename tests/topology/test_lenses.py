"""Regions and rings that planes cannot bound go; those that other surfaces or a step explain stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.plane import Plane
from sed2cad.topology.labelling import adjacency
from sed2cad.topology.lenses import without_lenses, without_tunnels
from sed2cad.topology.model import Chain, Topology
from sed2cad.topology.trace import trace
from tests.geometry import parts
from tests.topology import scans
from tests.topology.test_trace import check_closed


def on_top(fitted: list[FittedPatch], tilt: float, height: float) -> Plane:
    """The plane of the first patch, tilted by `tilt` radians and lifted."""
    plane = fitted[0].primitive
    assert isinstance(plane, Plane)
    side = np.cross(plane.normal_vector, np.roll(plane.normal_vector, 1))
    normal = np.cos(tilt) * plane.normal_vector + np.sin(tilt) * side / np.linalg.norm(side)
    middle = fitted[0].sign * height * plane.normal_vector + plane.offset * plane.normal_vector
    return Plane(normal, float(normal @ middle))


@pytest.mark.parametrize(("tilt", "height", "stays"), [(0.05, 0.0, False), (0.0, 0.06, True)], ids=["speck", "boss"])
def test_an_island_of_another_plane(tilt: float, height: float, stays: bool) -> None:
    scan, fitted = scans.scan_of(scans.box())
    traced = trace(scan, fitted)
    names = np.array([region.primitive for region in traced.topology.regions])[traced.labels]
    mesh, patch = traced.proxy, fitted[0]
    centres = mesh.centroids()
    middle = scan.points[patch.patch.indices].mean(axis=0)
    island = (names == 0) & (np.linalg.norm(centres - middle, axis=1) < 0.1)
    assert island.sum() > 5
    nothing = Patch(np.zeros(0, np.int64), "plane", np.zeros(0, bool))
    patches = [*fitted, replace(patch, patch=nothing, primitive=on_top(fitted, tilt, height))]
    labels = np.where(island, len(fitted), names)
    costs = np.column_stack([np.abs(p.primitive.distance(centres)) for p in patches])
    found = without_lenses(scan, patches, mesh, adjacency(mesh), costs, labels)
    assert (found == (labels if stays else names)).all()


def test_a_tunnel_between_two_planes_is_closed_and_a_bore_stays() -> None:
    part = parts.box_with_hole()
    edge = next(chain for chain in part.topology.chains if not chain.closed)
    number = len(part.topology.chains)
    ring = Chain(edge.points, edge.left, edge.right, -1, -1)
    regions = list(part.topology.regions)
    for region, way in ((edge.left, 1), (edge.right, -1)):
        regions[region] = replace(regions[region], loops=(*regions[region].loops, ((number, way),)))
    torn = Topology(tuple(regions), (*part.topology.chains, ring), part.topology.corners, part.topology.volume)
    found = without_tunnels(torn, part.fitted)
    check_closed(found)
    assert len(found.chains) == number
    assert [region.loops for region in found.regions] == [region.loops for region in part.topology.regions]
