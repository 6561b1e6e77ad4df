"""Directions, coordinates about an axis, sizes of residuals, and reading numbers back from a document."""

from __future__ import annotations

from typing import Any

import numpy as np

from sed2cad.primitives.base import Array

_TINY = 1e-300


def unit(vectors: Array) -> Array:
    """Vectors (..., 3) divided by their lengths; zero vectors stay zero."""
    length = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return np.asarray(vectors / np.maximum(length, _TINY)[..., None], dtype=float)


def tangent_frame(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors x, y (3,) with x, y, axis right-handed. The same axis always gives the same frame."""
    x0, x1, x2 = axis
    sign = 1.0 if x2 >= 0 else -1.0  # Duff et al. 2017, Building an Orthonormal Basis, Revisited
    a = -1.0 / (sign + x2)
    b = x0 * x1 * a
    return (
        np.array([1.0 + sign * x0 * x0 * a, sign * b, -sign * x0]),
        np.array([b, sign + x1 * x1 * a, -x1]),
    )


def tilted(axis: Array, angles: Array) -> Array:
    """The axis (3,) turned by two small angles (2,), radians, towards the x and y of its tangent frame."""
    x, y = tangent_frame(axis)
    return unit(axis + angles[0] * x + angles[1] * y)


def about_axis(points: Array, origin: Array, axis: Array) -> tuple[Array, Array, Array]:
    """Cylindrical coordinates of points (n, 3): height (n,), radius (n,), unit radial direction (n, 3).

    On the axis itself, where no radial direction is defined, any one across the axis is given.
    """
    offset = points - origin
    height = offset @ axis
    across = offset - height[:, None] * axis
    radius = np.sqrt(np.einsum("ij,ij->i", across, across))
    radial = across / np.maximum(radius, _TINY)[:, None]
    on_axis = radius < 1e-15
    if on_axis.any():
        radial[on_axis] = tangent_frame(axis)[0]
    return height, radius, radial


def across_components(radial: Array, axis: Array) -> Array:
    """Components (n, 2) of vectors (n, 3) along the x and y of the axis' tangent frame."""
    return radial @ np.column_stack(tangent_frame(axis))


def root_mean_square(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def triple(vector: Array) -> tuple[float, float, float]:
    """An array (3,) as plain floats, for JSON."""
    return float(vector[0]), float(vector[1]), float(vector[2])


def read_vector(parameters: dict[str, Any], name: str) -> Array:
    """The vector (3,) called `name`. ValueError where it is missing or not three finite numbers."""
    try:
        vector = np.asarray(parameters[name], dtype=float)
    except KeyError:
        raise ValueError(f"The parameter '{name}' is missing.") from None
    except (TypeError, ValueError):
        raise ValueError(f"The parameter '{name}' must be three numbers.") from None
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"The parameter '{name}' must be three finite numbers.")
    return vector


def read_direction(parameters: dict[str, Any], name: str) -> Array:
    """The vector (3,) called `name`, made a unit vector. ValueError where it has no length."""
    vector = read_vector(parameters, name)
    length = float(np.linalg.norm(vector))
    if length < 1e-12:
        raise ValueError(f"The direction '{name}' has no length.")
    return vector / length


def read_number(parameters: dict[str, Any], name: str) -> float:
    """The finite number called `name`."""
    try:
        number = float(parameters[name])
    except KeyError:
        raise ValueError(f"The parameter '{name}' is missing.") from None
    except (TypeError, ValueError):
        raise ValueError(f"The parameter '{name}' must be a number.") from None
    if not np.isfinite(number):
        raise ValueError(f"The parameter '{name}' must be finite.")
    return number


def read_length(parameters: dict[str, Any], name: str) -> float:
    """The positive number called `name`."""
    number = read_number(parameters, name)
    if number <= 0:
        raise ValueError(f"The parameter '{name}' must be positive, not {number:g}.")
    return number


def read_table(parameters: dict[str, Any], name: str) -> Array:
    """The array called `name`. ValueError where it is missing or not made of finite numbers."""
    try:
        table = np.asarray(parameters[name], dtype=float)
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"The parameter '{name}' is missing or not made of numbers.") from None
    if not np.isfinite(table).all():
        raise ValueError(f"The parameter '{name}' must be finite.")
    return table
