"""Points between two surfaces, moved to where these cross or touch."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.contact import Side, relative_curvature
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Array

_SHALLOW = np.radians(15.0)  # wider angles between the normals always cross
_LEVEL = np.radians(2.0)  # narrower ones never do
_LEAST_CURVATURE = 0.3  # 1 / unit: flatter contacts do not say where they are
_TURNS = 6


def meeting(a: Side, b: Side, points: Array, reach: float) -> tuple[Array, Array]:
    """Points (n, 3) on the common curve of a and b nearest to the given ones, and how far (n,) they miss it.

    Tangent surfaces meet where their normals agree, if that is within `reach`; free-form ones only where they
    cross at an angle. Where there is nothing to find the miss is inf.
    """
    outward = np.einsum("ij,ij->i", a.outward(points), b.outward(points))
    angle = float(np.median(np.arccos(np.clip(outward, -1, 1))))
    if angle > _SHALLOW:
        return _crossing(a, b, points)
    if a.free or b.free:
        return points, np.full(len(points), np.inf)
    curvature = float(np.median(relative_curvature(a, b, points).curvature))
    if curvature > _LEAST_CURVATURE and angle < 2 * reach * curvature:
        return _touching(a, b, points)
    if angle > _LEVEL:
        return _crossing(a, b, points)
    return points, np.full(len(points), np.inf)


def _crossing(a: Side, b: Side, points: Array) -> tuple[Array, Array]:
    """Least-norm Newton steps onto both."""
    one, two = a.primitive, b.primitive
    found = points.copy()
    for _ in range(_TURNS):
        da, db, na, nb = one.distance(found), two.distance(found), one.normal(found), two.normal(found)
        cosine = np.einsum("ij,ij->i", na, nb)
        determinant = np.maximum(1 - cosine**2, 1e-3)
        along_a, along_b = (da - cosine * db) / determinant, (db - cosine * da) / determinant
        found = found - along_a[:, None] * na - along_b[:, None] * nb
    return found, np.maximum(np.abs(one.distance(found)), np.abs(two.distance(found)))


def _touching(a: Side, b: Side, points: Array) -> tuple[Array, Array]:
    """To the middle surface and, sideways on it, to where the normals agree."""
    found = points.copy()
    for _ in range(_TURNS):
        contact = relative_curvature(a, b, found)
        na, nb = a.outward(found), b.outward(found)
        normal = unit(na + nb)
        middle = 0.5 * (a.sign * a.primitive.distance(found) + b.sign * b.primitive.distance(found))
        apart = np.einsum("ij,ij->i", na - nb, contact.across)
        push = apart / np.maximum(contact.curvature, _LEAST_CURVATURE)
        sideways = contact.sideways - np.einsum("ij,ij->i", contact.sideways, normal)[:, None] * normal
        found = found - middle[:, None] * normal - push[:, None] * sideways
    return found, np.maximum(np.abs(a.primitive.distance(found)), np.abs(b.primitive.distance(found)))
