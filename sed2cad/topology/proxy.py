"""The proxy: a closed, oriented, manifold triangle mesh of the part, from which the topology is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from gpytoolbox import point_cloud_to_mesh
from scipy.spatial import cKDTree

from sed2cad.components import components
from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.carve import carved, fewest_handles
from sed2cad.topology.edges import surface_samples
from sed2cad.topology.manifold import (
    bodies,
    is_closed_manifold,
    nearest_triangles,
    split_edges,
    split_fans,
    twins,
    used,
)
from sed2cad.topology.mirror import mirrored
from sed2cad.topology.samples import Samples, thinned
from sed2cad.topology.slivers import without_caps

_GOOD = 0.02  # share of badly met points that no further attempt would improve much
_CLEARLY = 0.02  # by which a later attempt must be better
MOST_SAMPLES = 25_000
_MOST_TRIANGLES = 150_000
_LONGEST_EDGE = 0.03  # unit frame: of the proxy's triangles away from borders
_POISSON_DEPTH = 8
_LEAST_HEIGHT = 1e-6  # unit frame: of the triangles of the input mesh


def proxy_mesh(scan: Scan, fitted: Sequence[FittedPatch] = ()) -> Mesh:
    """The best proxy of the scan, unit frame. AssemblyError when there is none.

    The input mesh if it is closed; else the carved samples of the fitted surfaces; screened Poisson if those
    do not explain the points.
    """
    own = closed_input(scan)
    if own is not None:
        return own
    best: tuple[float, Mesh] | None = None
    for attempt in _attempts(scan, fitted):
        mesh = attempt()
        if mesh is None or not encloses(mesh):
            continue
        quality = proxy_quality(mesh, scan)
        if best is None or quality < best[0] - _CLEARLY:
            best = quality, mesh
        if best[0] < _GOOD:
            break
    if best is None:
        raise AssemblyError("No closed surface could be laid through the points of the scan.")
    return best[1]


def encloses(mesh: Mesh) -> bool:
    """Whether a mesh is closed and its triangles look outwards."""
    return is_closed_manifold(mesh.faces) and mesh.volume() > 0


def proxy_quality(mesh: Mesh, scan: Scan) -> float:
    """Share of the points farther from the mesh than it may be, or facing away."""
    distance, triangle = nearest_triangles(mesh, scan.points)
    far = distance > scan.reach
    normals, _ = mesh.face_normals()
    opposed = np.einsum("ij,ij->i", normals[triangle], scan.normals) < -0.3
    return float((far | opposed).mean())


def _attempts(scan: Scan, fitted: Sequence[FittedPatch]) -> list[Callable[[], Mesh | None]]:
    """Ways to a proxy, the best first."""
    if not fitted:
        return [lambda: poisson(scan.points, scan.normals)]
    samples, spacing = few_enough(surface_samples(scan, fitted), scan.spacing)
    return [
        lambda: _carved_both(samples, fitted, spacing),
        lambda: poisson(samples.points, samples.normals[:, 0]),
        lambda: poisson(scan.points, scan.normals),
    ]


def smooth_proxy(scan: Scan, fitted: Sequence[FittedPatch]) -> Mesh:
    """The Poisson surface through samples of the fitted surfaces: a second opinion with rounded edges.

    AssemblyError where it is not closed.
    """
    samples, _ = few_enough(surface_samples(scan, fitted), scan.spacing)
    mesh = poisson(samples.points, samples.normals[:, 0])
    if mesh is None or not encloses(mesh):
        raise AssemblyError("No closed surface could be laid through the points of the scan.")
    return mesh


def _carved_both(samples: Samples, fitted: Sequence[FittedPatch], spacing: float) -> Mesh:
    """Carved with and without mirrored samples: these close thin walls, but crowd narrow gaps."""
    more = mirrored(samples, fitted, spacing)
    meshes = [carved(more, spacing)]
    if len(more) > 1.01 * len(samples):
        meshes.append(carved(samples, spacing))
    return fewest_handles(meshes)


def few_enough(samples: Samples, spacing: float, most: int = MOST_SAMPLES) -> tuple[Samples, float]:
    """At most about so many of the samples, evenly, and their spacing."""
    cell = spacing
    while len(samples) > most:
        cell *= 1.3
        samples = thinned(samples, cell)
    if cell > spacing:
        near, _ = cKDTree(samples.points).query(samples.points, k=2)
        spacing = float(np.median(near[:, 1]))
    return samples, spacing


def poisson(points: Array, normals: Array) -> Mesh | None:
    """Screened Poisson surface (Kazhdan and Hoppe 2013), without the parts that few points support."""
    vertices, faces = point_cloud_to_mesh(points, normals, psr_screening_weight=4.0, psr_depth=_POISSON_DEPTH)
    faces = faces.astype(np.int64)
    if len(faces) == 0:
        return None
    twin = twins(faces)
    if (twin < 0).any():
        return None
    return supported(split_fans(vertices, faces, twin), points)


def supported(mesh: Mesh, points: Array) -> Mesh:
    """The bodies of the mesh that at least 1 % of the points are nearest to."""
    number, body = bodies(mesh.faces)
    _, nearest = cKDTree(mesh.centroids()).query(points)
    support = np.bincount(body[nearest], minlength=number)
    return used(Mesh(mesh.vertices, mesh.faces[(support >= 0.01 * len(points))[body]]))


def closed_input(scan: Scan) -> Mesh | None:
    """The scan's own mesh, welded, outward and finely divided, if it is closed and manifold."""
    if scan.mesh is None:
        return None
    mesh = welded(scan.mesh)
    if len(mesh.faces) == 0 or (twins(mesh.faces) < 0).any():
        return None
    mesh = split_fans(mesh.vertices, mesh.faces, twins(mesh.faces))
    if mesh.volume() < 0:
        mesh = Mesh(mesh.vertices, mesh.faces[:, ::-1].copy())
    return divided(without_caps(mesh, _LEAST_HEIGHT), _LONGEST_EDGE)


def welded(mesh: Mesh, distance: float = 1e-6) -> Mesh:
    """The mesh with vertices nearer than `distance` made one and collapsed triangles left out."""
    pairs = cKDTree(mesh.vertices).query_pairs(distance, output_type="ndarray")
    number, group = components(len(mesh.vertices), pairs)
    vertices = np.zeros((number, 3))
    vertices[group] = mesh.vertices
    faces = group[mesh.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return used(Mesh(vertices, faces[whole]))


def divided(mesh: Mesh, longest: float) -> Mesh:
    """The mesh with edges above `longest` halved until none is left or the triangles are many."""
    while len(mesh.faces) < _MOST_TRIANGLES / 2:
        twin = twins(mesh.faces)
        long = mesh.edge_lengths().ravel() > longest
        if not long.any():
            break
        mesh = split_edges(mesh, twin, long | long[twin])
    return mesh
