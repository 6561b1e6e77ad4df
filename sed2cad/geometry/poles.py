"""The axis of a spherical face: its poles want to be the centres of circles, or else away from all edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sed2cad.geometry.curves import TURN, Arc, Array, Circle
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.vectors import tangent_frame, unit

_CAP = 0.1  # cosine: a face that keeps this far within a hemisphere is a patch seen away from both poles


def sphere_pole(sphere: Sphere, loops: Sequence[Sequence[Arc]], cover: Array) -> tuple[Array, Array]:
    """Pole axis z (3,) and preferred seam direction x (3,) of a face with boundary arcs, points cover (n, 3).

    A whole circle puts the pole at its centre. A patch lies about the equator, the seam behind it.
    Otherwise the poles keep as far from the edges as they can.
    """
    circles = [c for loop in loops if (c := _whole_circle(loop)) is not None]
    if circles:
        axis = max(circles, key=lambda c: c.radius).axis
        return axis, tangent_frame(axis)[0]
    edges = [arc.sampled(25) for loop in loops for arc in loop]
    ways = unit(np.vstack([cover, *edges]) - sphere.centre)
    middle = unit(ways.mean(axis=0))
    if middle.any() and (ways @ middle).min() > _CAP:
        return tangent_frame(middle)[0], -middle
    if not edges:
        return np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    candidates = _directions(200)
    nearest = np.abs(candidates @ unit(np.vstack(edges) - sphere.centre).T).max(axis=1)
    pole = candidates[int(nearest.argmin())]
    return pole, tangent_frame(pole)[0]


def _whole_circle(loop: Sequence[Arc]) -> Circle | None:
    """The circle that a loop goes once around, where it is one."""
    first = loop[0].curve
    if not isinstance(first, Circle):
        return None
    turned = 0.0
    for arc in loop:
        curve = arc.curve
        if not isinstance(curve, Circle) or np.linalg.norm(curve.centre - first.centre) > 1e-6:
            return None
        turned += arc.last - arc.first
    return first if abs(turned - TURN) < 1e-3 else None


def _directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly over a hemisphere (Fibonacci)."""
    k = np.arange(count) + 0.5
    height, angle = k / count, k * np.pi * (1 + 5**0.5)
    radius = np.sqrt(1 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
