"""The unbounded surfaces of a part's faces, all at once: projection in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.types import BSPLINE, CONE, CYLINDER, PLANE, SPHERE, TORUS

SAME_SURFACE = 2e-4
"""Two analytic surfaces are one when they differ by less than this (part scaled to longest side 1)."""


@dataclass(frozen=True)
class Surfaces:
    """f surfaces in the unit frame; those of B-splines have no parameters (zeros)."""

    type: NDArray[np.int8]  # (f,) index into PATCH_TYPES
    origin: NDArray[np.float64]  # (f, 3) a point of the plane or of the axis, the apex, the centre
    axis: NDArray[np.float64]  # (f, 3) unit; of a cone from the apex into the nappe
    radii: NDArray[np.float64]  # (f, 2) radius; half angle of a cone; major and minor radius of a torus

    def __getitem__(self, rows: NDArray) -> Surfaces:
        return Surfaces(self.type[rows], self.origin[rows], self.axis[rows], self.radii[rows])

    def project(self, points: NDArray) -> tuple[NDArray, NDArray]:
        """Feet (f, 3) of one point each, and unit normals there (away from axis or centre).

        Every kind is a surface of revolution, so only (distance from the axis, height along it) changes.
        B-splines: the point itself, normal 0.
        """
        offset = points - self.origin
        height = np.einsum("ij,ij->i", offset, self.axis)
        across = offset - height[:, None] * self.axis
        distance = np.linalg.norm(across, axis=1)
        radial = across / np.maximum(distance, 1e-300)[:, None]
        meridian = np.column_stack([distance, height])
        foot, normal = meridian.copy(), np.zeros_like(meridian)
        for kind, project in _MERIDIANS.items():
            rows = np.flatnonzero(self.type == kind)
            foot[rows], normal[rows] = project(meridian[rows], self.radii[rows])
        feet = self.origin + foot[:, :1] * radial + foot[:, 1:] * self.axis
        free = self.type == BSPLINE
        feet[free] = points[free]
        return feet, normal[:, :1] * radial + normal[:, 1:] * self.axis

    def same(self, i: int, j: int) -> bool:
        """Whether two surfaces are one; B-splines are never compared."""
        if self.type[i] != self.type[j] or self.type[i] == BSPLINE:
            return False
        if self.type[i] != SPHERE and abs(self.axis[i] @ self.axis[j]) < 1 - 1e-6:
            return False
        gap = self.origin[j] - self.origin[i]
        along = self.axis[i] * (self.axis[i] @ gap)
        gap = {PLANE: along, CYLINDER: gap - along}.get(int(self.type[i]), gap)
        close = np.allclose(self.radii[i], self.radii[j], 0, SAME_SURFACE)
        return bool(close and np.linalg.norm(gap) < SAME_SURFACE)


def _plane(meridian: NDArray, radii: NDArray) -> tuple[NDArray, NDArray]:
    return meridian * [1, 0], np.tile([0.0, 1.0], (len(meridian), 1))


def _cylinder(meridian: NDArray, radii: NDArray) -> tuple[NDArray, NDArray]:
    return np.column_stack([radii[:, 0], meridian[:, 1]]), np.tile([1.0, 0.0], (len(meridian), 1))


def _cone(meridian: NDArray, radii: NDArray) -> tuple[NDArray, NDArray]:
    along = np.column_stack([np.sin(radii[:, 0]), np.cos(radii[:, 0])])
    reach = np.einsum("ij,ij->i", meridian, along)[:, None]
    return reach * along, along[:, ::-1] * [1, -1]


def _sphere(meridian: NDArray, radii: NDArray) -> tuple[NDArray, NDArray]:
    normal = meridian / np.maximum(np.linalg.norm(meridian, axis=1, keepdims=True), 1e-300)
    return normal * radii[:, :1], normal


def _torus(meridian: NDArray, radii: NDArray) -> tuple[NDArray, NDArray]:
    centre = radii[:, :1] * [1, 0]
    normal = meridian - centre
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return centre + radii[:, 1:] * normal, normal


_MERIDIANS = {PLANE: _plane, CYLINDER: _cylinder, CONE: _cone, SPHERE: _sphere, TORUS: _torus}
"""(distance from the axis, height) (n, 2) and radii (n, 2) to foot (n, 2) and normal (n, 2) there."""
