"""Surfaces made of parallel straight lines, and the lines that two of them share."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.curves import Array, Line
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.vectors import unit

_PARALLEL = 1e-3  # radians


def common_ruling(a: Primitive, b: Primitive, start: Array, end: Array) -> Line | None:
    """The line from start to end (3,), where both surfaces consist of lines in its direction.

    Two planes, which have no direction of their own, never give one.
    """
    way = _way(a) if _way(a) is not None else _way(b)
    span = end - start
    if way is None or not (_ruled(a, way) and _ruled(b, way)):
        return None
    if not np.linalg.norm(np.cross(way, span)) < _PARALLEL * np.linalg.norm(span):  # nor a point
        return None
    return Line(start, unit(span))


def _way(primitive: Primitive) -> Array | None:
    """The direction (3,) of the lines; None where there are none, or too many."""
    if isinstance(primitive, Extrusion):
        return primitive.direction
    return primitive.axis if isinstance(primitive, Cylinder) else None


def _ruled(primitive: Primitive, way: Array) -> bool:
    """Whether a surface consists of lines in the direction (3,)."""
    if isinstance(primitive, Plane):
        return bool(abs(primitive.normal_vector @ way) < _PARALLEL)
    own = _way(primitive)
    return own is not None and bool(np.linalg.norm(np.cross(own, way)) < _PARALLEL)
