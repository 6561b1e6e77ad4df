"""A part to draw labelled clouds from: its mesh, the exact surface of every face, its edges. A few KB on disk."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.network.types import BSPLINE
from sed2cad.training.surfaces import Surfaces

FAR_FROM_EDGES = 0.1
"""Distances to edges are capped here."""
EDGE_SPACING = 3e-3
"""Spacing of the points that stand for an edge."""
EDGE_UNIT = 2e-5
"""Edge points are stored as whole multiples of this (unit frame)."""
NORMAL_UNIT = 1 / 32_000
"""Components of stored normals are whole multiples of this."""
BULGE = 0.5
"""Share of Phong tessellation; a half makes it exact where the curvature is constant."""


@dataclass(frozen=True)
class LabelledCloud:
    """A cloud in the unit frame (bounding box centred, longest side 1) with its truth, n points."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3) unit, outward, exact
    facet_normals: NDArray[np.float16]  # (n, 3) normals of the tessellation, as a mesh scan has them
    patch: NDArray[np.int16]  # (n,) patch id, 0 .. patches-1
    type: NDArray[np.int8]  # (n,) index into PATCH_TYPES
    edge_distance: NDArray[np.float16]  # (n,) to the nearest edge between two patches, at most FAR_FROM_EDGES
    closed: NDArray[np.bool_]  # (n,) its surface is closed in a direction: tells the paper's two B-splines apart


@dataclass(frozen=True)
class LabelledPart:
    """A part in the unit frame: n nodes, m triangles, f faces, p patches, e points on edges.

    B-spline faces have no parameters: their points come from the triangles, bulged by the normals.
    """

    nodes: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.int16]  # (n, 3) outward, in NORMAL_UNIT; 0 on analytic faces, which need none
    triangles: NDArray[np.integer]  # (m, 3) nodes, counterclockwise from outside; uint16 where that is enough
    face: NDArray[np.uint16]  # (m,) of each triangle
    patch: NDArray[np.int16]  # (f,) touching faces on one surface are one patch
    type: NDArray[np.int8]  # (f,) index into PATCH_TYPES
    closed: NDArray[np.bool_]  # (f,) the surface is closed (or periodic) in a direction
    disguised: NDArray[np.bool_]  # (f,) an analytic surface that the file holds as a freeform one
    side: NDArray[np.int8]  # (f,) +1 where the surface's own normal points outward, else -1
    origin: NDArray[np.float64]  # (f, 3), see Surfaces
    axis: NDArray[np.float64]  # (f, 3)
    radii: NDArray[np.float64]  # (f, 2)
    edges: NDArray[np.int16]  # (e, 3) polylines along the edges between patches, in EDGE_UNIT
    edge_start: NDArray[np.uint16 | np.uint32]  # (polylines,) first row of each

    def save(self, path: Path) -> None:
        """Write a compressed .npz."""
        with path.open("wb") as stream:
            np.savez_compressed(stream, **asdict(self))

    @classmethod
    def load(cls, path: Path) -> LabelledPart:
        """Read what `save` wrote. Raises OSError, ValueError or KeyError where it is something else."""
        with np.load(path, allow_pickle=False) as arrays:
            return cls(**{name: arrays[name] for name in cls.__dataclass_fields__})

    @property
    def surfaces(self) -> Surfaces:
        """The exact surface of each face."""
        return Surfaces(self.type, self.origin, self.axis, self.radii)

    def sample(self, rng: np.random.Generator, count: int, labelled: int | None = None) -> LabelledCloud:
        """Fresh points, uniform by area, on the exact surfaces.

        Only the first `labelled` points (default: all) get their distance to edges, the costly label.
        """
        normals, areas = self._facets
        cumulated = np.cumsum(areas)
        pick = np.minimum(np.searchsorted(cumulated, rng.random(count) * cumulated[-1]), len(areas) - 1)
        weight = rng.random((count, 2))
        weight = np.where(weight.sum(1, keepdims=True) > 1, 1 - weight, weight)
        weight = np.column_stack([1 - weight.sum(1), weight])
        face = self.face[pick]
        flat = np.einsum("ij,ijk->ik", weight, self.nodes[self.triangles[pick]].astype(np.float64))
        points, exact = self.surfaces[face].project(flat)
        exact *= self.side[face, None]
        free = np.flatnonzero(self.type[face] == BSPLINE)
        points[free], exact[free] = self._bulged(flat[free], weight[free], pick[free])
        facet = normals[pick]
        lost = np.einsum("ij,ij->i", exact, exact) < 0.25  # on an axis or at a pole
        exact[lost] = facet[lost]
        return self.cloud(points, exact, facet, face, labelled)

    def cloud(
        self, points: NDArray, normals: NDArray, facet_normals: NDArray, face: NDArray, labelled: int | None = None
    ) -> LabelledCloud:
        """Points with normals, (n, 3) each, on faces (n,); only the first `labelled` get their distance to edges."""
        distance = np.full(len(points), FAR_FROM_EDGES)
        distance[:labelled] = self.edge_distance(points[:labelled])
        return LabelledCloud(
            points.astype(np.float32),
            normals.astype(np.float32),
            facet_normals.astype(np.float16),
            self.patch[face],
            self.type[face],
            distance.astype(np.float16),
            self.closed[face],
        )

    def edge_distance(self, points: NDArray) -> NDArray:
        """Distance (n,) to the nearest edge between two patches, at most FAR_FROM_EDGES."""
        on_edges = self._on_edges
        if not len(on_edges):
            return np.full(len(points), FAR_FROM_EDGES)
        distance, _ = cKDTree(on_edges).query(points, distance_upper_bound=FAR_FROM_EDGES)
        return np.minimum(distance, FAR_FROM_EDGES)

    @cached_property
    def _on_edges(self) -> NDArray:
        """Points along the edges, EDGE_SPACING apart or nearer."""
        corners = self.edges * EDGE_UNIT
        start, step = corners[:-1], np.diff(corners, axis=0)
        inside = ~np.isin(np.arange(1, len(corners)), self.edge_start)  # no step from one polyline to the next
        start, step = start[inside], step[inside]
        parts = np.ceil(np.linalg.norm(step, axis=1) / EDGE_SPACING).astype(np.int64).clip(1)
        first = np.repeat(np.cumsum(parts) - parts, parts)
        share = (np.arange(parts.sum()) - first) / np.repeat(parts, parts)
        return np.vstack([np.repeat(start, parts, 0) + share[:, None] * np.repeat(step, parts, 0), corners])

    @cached_property
    def _facets(self) -> tuple[NDArray, NDArray]:
        """Outward unit normal (m, 3) and area (m,) of each triangle."""
        return facets(self.nodes, self.triangles)

    def _bulged(self, flat: NDArray, weight: NDArray, triangle: NDArray) -> tuple[NDArray, NDArray]:
        """Points and unit normals over flat triangles (Boubekeur and Alexa, Phong Tessellation, 2008)."""
        corners = self.triangles[triangle]
        normal = self.normals[corners] * NORMAL_UNIT
        off = np.einsum("ikj,ikj->ik", flat[:, None] - self.nodes[corners], normal) * weight
        points = flat - BULGE * np.einsum("ik,ikj->ij", off, normal)
        smooth = np.einsum("ik,ikj->ij", weight, normal)
        return points, smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-9)


def facets(nodes: NDArray, triangles: NDArray) -> tuple[NDArray, NDArray]:
    """Unit normals (m, 3) and areas (m,) of triangles (m, 3)."""
    a, b, c = (nodes[triangles[:, k]].astype(np.float64) for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    return normals / np.maximum(length, 1e-300)[:, None], length / 2
