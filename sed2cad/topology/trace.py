"""From the scan and its fitted patches to the topology."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.loose import loose_among
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.bridges import bridged_labels
from sed2cad.topology.caps import Cap, levelled, missing_cap, nearest_centres
from sed2cad.topology.chains import build_topology
from sed2cad.topology.closing import closable
from sed2cad.topology.labelling import Adjacency, adjacency, data_costs, label_triangles
from sed2cad.topology.lenses import without_lenses, without_tunnels
from sed2cad.topology.mincut import Labels
from sed2cad.topology.model import Topology
from sed2cad.topology.proxy import proxy_mesh
from sed2cad.topology.regions import cleaned_labels, connected, support_of, unpinch
from sed2cad.topology.samples import settled_labels
from sed2cad.topology.torn import strips_closed


@dataclass(frozen=True)
class Traced:
    """The topology and what it was read from."""

    topology: Topology
    fitted: list[FittedPatch]  # the given ones and, after them, the caps that were missing
    proxy: Mesh
    labels: Labels  # (f,) region of each triangle of the proxy
    caps: tuple[int, ...] = ()  # which of the patches nobody saw


def trace(
    scan: Scan,
    fitted: Sequence[FittedPatch],
    smoothness: float = 1.0,
    proxy: Mesh | None = None,
    unseen: Labels | None = None,
) -> Traced:
    """Regions, chains and corners of the part. AssemblyError when there is no closed proxy or no patch.

    proxy: that of an earlier trace of the same scan and patches, so that it is not made again; unseen: triangles of it
    that lie on no surface, but on a last patch that has none.
    """
    if not any(len(patch.patch.indices) for patch in fitted):
        raise AssemblyError("No surface was found on the scan.")
    mesh = proxy or proxy_mesh(scan, fitted)
    points = settled_labels(scan, fitted)
    near = adjacency(mesh)
    costs = data_costs(mesh, scan, fitted, points)
    if unseen is not None:
        costs[unseen] = np.inf
        costs[unseen, -1] = 0.0
    labels = label_triangles(mesh, near, costs, smoothness)
    support = support_of(mesh, scan, points)
    labels = cleaned_labels(mesh, near, costs, labels, support)
    whole = bridged_labels(scan, fitted, mesh, near, labels)
    whole = strips_closed(scan, fitted, mesh, near, whole)
    if (whole != labels).any():
        labels = cleaned_labels(mesh, near, costs, whole, support)
    labels = without_lenses(scan, fitted, mesh, near, costs, labels)
    return _with_caps(scan, list(fitted), mesh, near, costs, labels)


def retraced(
    scan: Scan, mesh: Mesh, fitted: Sequence[FittedPatch], labels: Labels, caps: tuple[int, ...] = ()
) -> Traced:
    """The topology of changed labels (f,) of a proxy's triangles; caps: those that there are."""
    centres = mesh.centroids()
    costs = np.column_stack([np.abs(patch.primitive.distance(centres)) for patch in fitted]) / scan.spacing
    traced = _with_caps(scan, list(fitted), mesh, adjacency(mesh), costs, unpinch(mesh, costs, labels))
    return replace(traced, caps=caps + traced.caps)


def _with_caps(
    scan: Scan, fitted: list[FittedPatch], mesh: Mesh, near: Adjacency, costs: Array, labels: Labels
) -> Traced:
    """The topology of the labels (f,), with the planes that it takes to close every cylinder and cone of a closed part.
    """
    topology, region = _topology(mesh, near, labels)
    caps: list[Cap] = []
    nearest = cache(lambda: nearest_centres(scan, mesh))  # most parts lack no cap
    for _ in topology.regions if loose_among(fitted) is None else ():
        cap = missing_cap(scan, nearest, mesh, near, region, topology, [*fitted, *(cap.patch for cap in caps)])
        if cap is None:
            break
        before, labels = labels, labels.copy()
        labels[cap.triangles] = cap.known if cap.known >= 0 else len(fitted) + len(caps)
        if cap.known < 0:
            caps.append(cap)
            costs = np.column_stack([costs, np.abs(cap.patch.primitive.distance(mesh.centroids())) / scan.spacing])
        labels = unpinch(mesh, costs, labels)
        if np.array_equal(labels, before):  # it cannot be closed
            break
        topology, region = _topology(mesh, near, labels)
    places = tuple(range(len(fitted), len(fitted) + len(caps)))
    fitted = closable(scan, topology, [*fitted, *levelled(caps, mesh)])
    return Traced(without_tunnels(topology, fitted), fitted, mesh, region, places)


def _topology(mesh: Mesh, near: Adjacency, labels: Labels) -> tuple[Topology, Labels]:
    """The topology of the labels (f,) and the region (f,) of each triangle."""
    number, region = connected(labels, near)
    primitives = np.zeros(number, dtype=np.int64)
    primitives[region] = labels
    return build_topology(mesh, region, primitives), region
