"""Parallel surfaces: all points at one distance from a surface, on one side of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sed2cad.primitives.base import Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus


def parallel(surface: Primitive, by: float) -> Primitive | None:
    """The surface moved by a distance along its normals, negative against them; None where it is freeform, or narrower
    than that."""
    if isinstance(surface, Plane):
        return Plane(surface.normal_vector, surface.offset + by)
    if isinstance(surface, Cone):
        return replace(surface, apex=surface.apex - by / np.sin(surface.half_angle) * surface.axis)
    if isinstance(surface, Cylinder | Sphere) and surface.radius + by > 0:
        return replace(surface, radius=surface.radius + by)
    if isinstance(surface, Torus) and surface.minor_radius + by > 0:
        return replace(surface, minor_radius=surface.minor_radius + by)
    return None
