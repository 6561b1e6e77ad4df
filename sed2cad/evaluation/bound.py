"""How exactly noisy points can tell a primitive: the Cramer-Rao bound, and errors in its chart.

A point is p_i = f_i + e_i n_i: a foot f_i anywhere on the surface (two nuisance numbers each), and Gaussian noise e_i
with the deviation sigma along the normal n_i there. Split p_i in the tangent plane at its foot. What lies within the
plane is free, since f_i is: it tells nothing of the surface. What lies across is the signed distance d(p_i; theta),
Gaussian with mean 0. Eliminating the feet (the Schur complement of their block) leaves the Fisher information of the
shape theta, J^T J / sigma^2 with J_ik = d d(f_i; theta) / d theta_k, so no unbiased estimate has a covariance below
sigma^2 (J^T J)^-1 (Kanatani 1996, Statistical Optimization for Geometric Computation, chapter 7; Chernov 2010,
Circular and Linear Regression, section 7). It is reached as sigma goes to 0; where the bound is so wide that the
surface bends within it (a short arc, much noise), even maximum likelihood stays above it.
"""

from __future__ import annotations

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame


def cramer_rao(primitive: Primitive, feet: Array, sigma: float) -> Array:
    """The least covariance (freedom, freedom) in the chart of the true primitive, from feet (n, 3) on it.

    LinAlgError where they leave something open.
    """
    jacobian = primitive.jacobian(feet)
    scale = 1 / np.linalg.norm(jacobian, axis=0).clip(1e-300)
    inverse = np.linalg.inv((jacobian * scale).T @ (jacobian * scale))
    return np.asarray(sigma**2 * inverse * scale[:, None] * scale)


def chart_coordinates(primitive: Primitive, other: Primitive) -> Array:
    """delta (freedom,) with primitive.moved(delta) the surface `other` of the same kind: the inverse of `moved`.

    Axes and the normals of planes count as undirected. Directions at right angles give infinite tilts.
    """
    match primitive, other:
        case Plane(), Plane():
            tilts, sign = _tilts(primitive.normal_vector, other.normal_vector)
            return np.array([*tilts, sign * other.offset - primitive.offset])
        case Cylinder(), Cylinder():
            tilts, _ = _tilts(primitive.axis, other.axis)
            shift = _across(primitive.axis, primitive.point, other.axis, other.point)[0]
            return np.array([*tilts, *shift, other.radius - primitive.radius])
        case Cone(), Cone():
            tilts, sign = _tilts(primitive.axis, other.axis)
            pivot = primitive.apex + primitive.reach * primitive.axis
            shift, met = _across(primitive.axis, pivot, other.axis, other.apex)
            radius = float((met - other.apex) @ other.axis) * np.tan(other.half_angle)
            swelling = radius - primitive.reach * np.tan(primitive.half_angle)
            return np.array([*tilts, *shift, swelling, sign * other.half_angle - primitive.half_angle])
        case Sphere(), Sphere():
            return np.array([*(other.centre - primitive.centre), other.radius - primitive.radius])
        case Torus(), Torus():
            tilts, _ = _tilts(primitive.axis, other.axis)
            radii = other.major_radius - primitive.major_radius, other.minor_radius - primitive.minor_radius
            return np.array([*tilts, *(other.centre - primitive.centre), *radii])
    raise TypeError(f"a {other.kind} has no place in the chart of a {primitive.kind}")


def _tilts(axis: Array, other: Array) -> tuple[Array, float]:
    """Angles (2,) of `tilted` from one axis to the other, and -1 where the other had to be turned about."""
    cosine = float(axis @ other)
    with np.errstate(divide="ignore"):
        return np.stack(tangent_frame(axis)) @ other / np.float64(cosine), float(np.copysign(1.0, cosine))


def _across(axis: Array, pivot: Array, other: Array, point: Array) -> tuple[Array, Array]:
    """Where the line (point, other) meets the plane across the axis at the pivot: along x and y (2,), in space."""
    with np.errstate(divide="ignore"):
        met = point + other * ((pivot - point) @ axis / np.float64(other @ axis))
    return np.stack(tangent_frame(axis)) @ (met - pivot), met
