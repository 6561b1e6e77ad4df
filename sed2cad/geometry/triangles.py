"""Points and triangles in space."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.curves import Array


def point_triangle(p: Array, a: Array, b: Array, c: Array) -> Array:
    """Distances between points and triangles, arrays that broadcast to (..., 3)."""

    def dot(x: Array, y: Array) -> Array:
        return np.einsum("...i,...i->...", x, y)

    def to_segment(start: Array, end: Array) -> Array:
        way = end - start
        t = np.clip(dot(p - start, way) / np.maximum(dot(way, way), 1e-300), 0, 1)
        return np.asarray(np.linalg.norm(p - start - t[..., None] * way, axis=-1))

    ab, ac, ap = b - a, c - a, p - a
    aa, ac_ab, cc = dot(ab, ab), dot(ab, ac), dot(ac, ac)
    pb, pc = dot(ap, ab), dot(ap, ac)
    determinant = np.maximum(aa * cc - ac_ab * ac_ab, 1e-300)
    v, w = (cc * pb - ac_ab * pc) / determinant, (aa * pc - ac_ab * pb) / determinant
    on_plane = np.linalg.norm(ap - v[..., None] * ab - w[..., None] * ac, axis=-1)
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    at_border = np.minimum(np.minimum(to_segment(a, b), to_segment(b, c)), to_segment(c, a))
    return np.where(inside, on_plane, at_border)
