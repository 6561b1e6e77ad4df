"""What a CAD system's mesh knows exactly: its vertices lie on the surfaces that it was made from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Primitive
from sed2cad.primitives.refine import median_size, refine
from sed2cad.primitives.robust_fit import evenly
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import about_axis
from sed2cad.scan.mesh import planar_facets
from sed2cad.scan.sample import SMOOTH
from sed2cad.scan.scan import Mesh, Scan

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

EXACT = 2e-6  # unit frame: rounding moves the vertices by less
_ON = 2.0  # times that, for a vertex that is called on a surface
_NEARLY_ALL = 0.9
_MORE = 3  # vertices more than it takes to make a surface go through them
_ANY = 3  # circles about one axis that a torus goes through, whatever they are
_SAME = 1e-4  # unit frame: circles nearer than this are one
_MOST = 240  # vertices that a surface is laid through
_STEPS = 10
_STEPS_MORE = 30  # where a stray vertex slows the descent: one
_CLOSE = 2e-4  # unit frame: that has come as near as this to half of the vertices


@dataclass(frozen=True)
class Corners:
    """The triangles that n points lie on."""

    vertices: Array  # (v, 3) of the whole mesh
    triangles: Labels  # (n, 3) vertices around each point
    normals: Array  # (n, 3) of the flat triangles
    facets: Labels  # (n,) plane that each point is sure to lie on, or -1

    @classmethod
    def of(cls, scan: Scan) -> Corners | None:
        """Those of a scan's points; None where it is no mesh, or a measured one."""
        if scan.mesh is None or scan.triangle is None:
            return None
        return cls.of_triangles(scan.mesh, scan.triangle)

    @classmethod
    def of_triangles(cls, mesh: Mesh, on: Labels) -> Corners:
        """Those of points that lie on the triangles `on` (n,) of a mesh."""
        return cls(mesh.vertices, mesh.faces[on], mesh.face_normals()[0][on], planar_facets(mesh, SMOOTH)[on])

    def __getitem__(self, members: NDArray[np.int64] | slice) -> Corners:
        return Corners(self.vertices, self.triangles[members], self.normals[members], self.facets[members])

    def alone(self) -> Corners:
        """The same without the vertices that none of the points has around it."""
        own, triangles = np.unique(self.triangles, return_inverse=True)
        return Corners(self.vertices[own], triangles.reshape(-1, 3), self.normals, self.facets)

    def off(self, primitive: Primitive) -> Array:
        """Largest distance (n,) of the three from a primitive; infinite from one that only comes near its points."""
        if not primitive.freedom:
            return np.full(len(self.triangles), np.inf)
        if self.triangles.size > len(self.vertices):
            return np.asarray(np.abs(primitive.distance(self.vertices))[self.triangles].max(axis=1))
        corners = self.vertices[self.triangles.ravel()]
        return np.asarray(np.abs(primitive.distance(corners)).reshape(-1, 3).max(axis=1))

    def on(self, primitive: Primitive) -> NDArray[np.bool_]:
        """Which points (n,) have all three on a primitive."""
        return self.off(primitive) < _ON * EXACT

    def moved(self, primitive: Primitive) -> Primitive | None:
        """The primitive through the vertices; None where there are too few to tell."""
        places = np.unique(self.triangles)
        if not _tell(places, primitive):
            return None
        vertices = self.vertices[places[evenly(len(places), min(len(places), _MOST))]]
        found = refine(primitive, vertices, EXACT, _STEPS)
        if median_size(found.distance(vertices)) > _CLOSE:
            return found
        return refine(found, vertices, EXACT, _STEPS_MORE)

    def through_any(self, primitive: Primitive) -> bool:
        """Whether it is a torus through so few circles that there always is one, be they a cone's and a plane's."""
        if not isinstance(primitive, Torus):
            return False
        height, radius, _ = about_axis(self.vertices[np.unique(self.triangles)], primitive.centre, primitive.axis)
        circles = np.unique(np.round(np.column_stack([height, radius]) / _SAME), axis=0)
        return len(circles) <= _ANY

    def settle(self, primitive: Primitive) -> bool:
        """Whether a primitive goes through nearly all vertices, and they are enough to tell."""
        return _tell(np.unique(self.triangles), primitive) and bool(self.on(primitive).mean() > _NEARLY_ALL)


def _tell(places: Labels, primitive: Primitive) -> bool:
    """Whether there are more vertices (v,) than any surface of the primitive's kind can be made to go through."""
    return primitive.kind == "plane" or len(places) >= primitive.freedom + _MORE


def on_surfaces(scan: Scan, corners: Corners, found: Iterable[tuple[Labels, Primitive, int]]) -> Scan:
    """The scan with points and normals of the surfaces (members, primitive, sign) that the vertices lie on.

    What bulges between them was an estimate.
    """
    points, normals = scan.points.copy(), scan.normals.copy()
    for members, primitive, sign in found:
        own = corners[members]
        if not len(members) or not own.settle(primitive):
            continue
        better = own[np.flatnonzero(own.on(primitive))].moved(primitive) or primitive
        members = members[own.on(better)]
        points[members] = better.project(points[members])
        normals[members] = sign * better.normal(points[members])
    return replace(scan, points=points, normals=normals)
