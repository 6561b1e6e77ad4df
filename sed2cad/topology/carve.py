"""A closed surface through oriented samples: which Delaunay tetrahedra are inside, by a minimum cut.

After Labatut, Pons and Keriven 2009; instead of lines of sight the samples' normals say which tetrahedra
around them are inside. The samples stay where they are, so edges stay sharp and thin walls closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from sed2cad.components import components
from sed2cad.scan.scan import Array, Mesh
from sed2cad.topology.manifold import Faces, Index, bodies, euler_number, split_fans, twins
from sed2cad.topology.mincut import min_cut
from sed2cad.topology.samples import Mask, Samples

_OPPOSITE = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # facet across from each corner
_FAR = 2.0  # unit frame: half the size of the box around all
_SMOOTHNESS = (1.0, 3.0)  # what facets cost against votes
_OUTSIDE = 20.0  # vote of what is surely so
_JITTER = 1e-3  # spacings: no four samples in one plane, or on one circle


@dataclass(frozen=True)
class Tetrahedra:
    """A Delaunay triangulation."""

    points: Array  # (n, 3)
    corners: NDArray[np.int64]  # (t, 4), positively oriented
    neighbours: NDArray[np.int64]  # (t, 4) across from each corner, -1 outside

    def volumes(self) -> Array:
        """Volumes (t,)."""
        a, b, c, d = (self.points[self.corners[:, k]] for k in range(4))
        return np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) / 6

    def facets(self, tetrahedra: Index, across: Index) -> Faces:
        """The facets (m, 3) across from corners `across` of tetrahedra (m,), facing outwards."""
        return np.take_along_axis(self.corners[tetrahedra], _OPPOSITE[across], axis=1)

    def longest_edges(self, cells: NDArray[np.int64]) -> Array:
        """Lengths (m,) of the longest edges of triangles (m, 3) or tetrahedra (m, 4)."""
        ends = combinations(self.points[cells].swapaxes(0, 1), 2)
        return np.asarray(np.max([np.linalg.norm(a - b, axis=1) for a, b in ends], axis=0))


def carved(samples: Samples, spacing: float, longest: float = np.inf) -> Mesh:
    """The closed manifold surface (outward) of the part that the samples describe.

    Cut more and less smoothly: what goes wrong makes tunnels, so the surface with the fewest handles is kept.
    Tetrahedra with edges above `longest` are outside.
    """
    tetrahedra = triangulated(samples.points, spacing)
    votes = sample_votes(tetrahedra, samples)
    if longest < np.inf:
        votes[tetrahedra.longest_edges(tetrahedra.corners) > longest] = _OUTSIDE
    first, across = np.nonzero(tetrahedra.neighbours > np.arange(len(votes))[:, None])
    pairs = np.column_stack([first, tetrahedra.neighbours[first, across]])
    prices = _facet_prices(tetrahedra, tetrahedra.facets(first, across), samples, spacing)
    found = []
    for smoothness in _SMOOTHNESS:
        price = smoothness * prices
        inside = ~min_cut(np.maximum(votes, 0), np.maximum(-votes, 0), pairs, price, price)
        inside = without_islands(inside, tetrahedra, (6 * spacing) ** 3)
        found.append(boundary(tetrahedra, inside))
    return fewest_handles(found)


def fewest_handles(meshes: Sequence[Mesh]) -> Mesh:
    """The mesh with the fewest handles, of several that with the fewest bodies, then the first; none if it can."""

    def wrong(mesh: Mesh) -> tuple[bool, int, int]:
        number, _ = bodies(mesh.faces)
        return number == 0, number - euler_number(mesh.faces) // 2, number

    return min(meshes, key=wrong)


def triangulated(points: Array, spacing: float) -> Tetrahedra:
    """Delaunay triangulation of the points (n, 3) and of the corners of a large box around them."""
    rng = np.random.default_rng(0)
    box = _FAR * (2.0 * np.indices((2, 2, 2)).reshape(3, 8).T - 1)
    box = box * rng.uniform(0.9, 1.1, box.shape)
    moved = np.vstack([points + _JITTER * spacing * rng.standard_normal(points.shape), box])
    found = Delaunay(moved)
    corners, neighbours = found.simplices.astype(np.int64), found.neighbors.astype(np.int64)
    result = Tetrahedra(moved, corners, neighbours)
    inverted = result.volumes() < 0
    for table in (corners, neighbours):
        table[inverted, :2] = table[inverted, 1::-1]
    return Tetrahedra(moved, corners, neighbours)


def sample_votes(tetrahedra: Tetrahedra, samples: Samples) -> Array:
    """How strongly the samples around each tetrahedron (t,) call it outside (+, at most 4) or inside (-)."""
    corner = tetrahedra.corners.ravel()
    far = corner >= len(samples)
    corner = np.where(far, 0, corner)
    centres = np.repeat(tetrahedra.points[tetrahedra.corners].mean(axis=1), 4, axis=0)
    way = centres - tetrahedra.points[corner]
    way /= np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]
    above = np.einsum("ij,ikj->ik", way, samples.normals[corner])
    above = np.where(samples.convex[corner], above.max(axis=1), above.min(axis=1))
    votes = np.where(far, 0.0, np.clip(5 * above, -1, 1)).reshape(-1, 4).sum(axis=1)
    return np.where(far.reshape(-1, 4).any(axis=1), _OUTSIDE, votes)


def _facet_prices(tetrahedra: Tetrahedra, facets: Faces, samples: Samples, spacing: float) -> Array:
    """Cost (m,) of a facet in the surface: dear where it is large or its corners share no face."""
    labels = np.vstack([samples.labels, np.column_stack([np.arange(-9, -1)] * 2)])
    a, b, c = (labels[facets[:, k]] for k in range(3))
    common = np.zeros(len(facets), dtype=bool)
    for k in (0, 1):
        shared = a[:, k : k + 1]
        common |= (b == shared).any(axis=1) & (c == shared).any(axis=1)
    longest = tetrahedra.longest_edges(facets)
    return np.where(common, 0.15, 1.0) * np.clip(longest / (4 * spacing), 0.3, 6.0)


def without_islands(inside: Mask, tetrahedra: Tetrahedra, least: float) -> Mask:
    """Small bodies (volume below `least`) become outside and small cavities inside."""
    volumes = np.abs(tetrahedra.volumes())
    for _ in range(3):
        first, across = np.nonzero(tetrahedra.neighbours > np.arange(len(inside))[:, None])
        second = tetrahedra.neighbours[first, across]
        same = inside[first] == inside[second]
        number, part = components(len(inside), np.column_stack([first, second])[same])
        small = np.bincount(part, volumes, minlength=number) < least
        if not small.any():
            break
        inside = inside ^ small[part]
    return inside


def boundary(tetrahedra: Tetrahedra, inside: Mask) -> Mesh:
    """The surface between inside and outside, made manifold by parting what only touches."""
    across = tetrahedra.neighbours
    tetrahedron, corner = np.nonzero(inside[:, None] & ~inside[across] & (across >= 0))
    faces = tetrahedra.facets(tetrahedron, corner)
    twin = twins(faces)
    for half in np.flatnonzero(twin < 0).tolist():
        twin[half] = _around(tetrahedra, inside, faces, tetrahedron, half)
    return split_fans(tetrahedra.points, faces, twin)


def _around(tetrahedra: Tetrahedra, inside: Mask, faces: Faces, owner: Index, half: int) -> int:
    """The twin of a half-edge with several: the one met first by walking around the edge inside the part."""
    a, b = faces[half // 3, half % 3], faces[half // 3, (half % 3 + 1) % 3]
    here, entry = int(owner[half // 3]), int(faces[half // 3, (half % 3 + 2) % 3])
    while True:
        others = [int(v) for v in tetrahedra.corners[here] if v not in (a, b, entry)]
        slot = int(np.flatnonzero(tetrahedra.corners[here] == entry)[0])
        nearer = int(tetrahedra.neighbours[here, slot])
        if not inside[nearer]:
            face = {int(a), int(b), others[0]}
            candidates = np.flatnonzero(owner == here)
            found = next(t for t in candidates if set(faces[t].tolist()) == face)
            return int(3 * found + int(np.flatnonzero(faces[found] == b)[0]))
        here, entry = nearer, others[0]
