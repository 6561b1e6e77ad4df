"""Freeform faces that are planes, cylinders, cones, spheres or tori in disguise: exported as B-splines, swept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.types import BSPLINE, PATCH_TYPES
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.starts import starts
from sed2cad.primitives.torus import Torus
from sed2cad.training.surfaces import Surfaces

DEVIATION = 1e-4
"""Largest distance of the face's points from the surface that it is (part scaled to longest side 1)."""
TURN = np.cos(np.radians(2.0))
"""Least cosine between their normals: nearly any surface fits the points of a strip, few its normals too."""
LARGEST = 20.0
"""Largest radius; what is flatter is no cylinder, sphere or torus to anyone who scans it."""
FEWEST = 20
"""Points that a surface is recognised from."""
ORDER = ("plane", "cylinder", "sphere", "cone", "torus")
"""The simplest that fits is taken."""


def recognise(points: NDArray, normals: NDArray) -> Surfaces | None:
    """The analytic surface (one row) on which points (n, 3) with exact unit normals (n, 3) lie, if any."""
    if len(points) < FEWEST:
        return None
    for kind in ORDER:
        for primitive in starts(kind, points, normals):
            off = np.abs(primitive.distance(points)).max()
            agree = np.einsum("ij,ij->i", primitive.normal(points), normals)
            agree = agree if agree.sum() > 0 else -agree
            if off < DEVIATION and agree.min() > TURN and (found := surface_of(primitive)).radii.max() < LARGEST:
                return found
    return None


def surface_of(primitive: Primitive) -> Surfaces:
    """A fitted primitive as one row of `Surfaces`."""
    match primitive:
        case Plane():
            row = primitive.normal_vector * primitive.offset, primitive.normal_vector, (0.0, 0.0)
        case Cylinder():
            row = primitive.point, primitive.axis, (primitive.radius, 0.0)
        case Cone():
            row = primitive.apex, primitive.axis, (primitive.half_angle, 0.0)
        case Sphere():
            row = primitive.centre, np.array([0.0, 0.0, 1.0]), (primitive.radius, 0.0)
        case Torus():
            row = primitive.centre, primitive.axis, (primitive.major_radius, primitive.minor_radius)
        case _:
            row = np.zeros(3), np.zeros(3), (0.0, 0.0)
    type_ = PATCH_TYPES.index(primitive.kind) if primitive.kind in ORDER else BSPLINE
    origin, axis, radii = (np.asarray(values, np.float64)[None] for values in row)
    return Surfaces(np.array([type_], np.int8), origin, axis, radii)
