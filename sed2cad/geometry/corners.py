"""Corners: the point that lies on all surfaces around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sed2cad.geometry.contact import Side, relative_curvature
from sed2cad.geometry.curves import Array

_RANKS = (0.02, 0.15, 0.3)  # singular values below this share of the largest are not solved for
_FAR = 0.025  # unit frame: a corner does not lie this far from where the proxy mesh has it
_STEPS = 25
_LONGEST_STEP = 0.02  # unit frame
_LEAST_CURVATURE = 0.5  # 1 / unit: flatter contacts do not say where they touch


@dataclass(frozen=True)
class Corner:
    """A solved corner."""

    position: Array  # (3,)
    residual: float  # largest distance from its surfaces, unit frame
    misfit: float  # largest residual of all, tangencies (as lengths) included
    moved: float  # from where the search started


def solve_corner(
    start: Array, sides: Sequence[Side], tangent: Sequence[tuple[Side, Side]], resting: bool = False
) -> Corner:
    """Gauss-Newton from `start` (3,) onto all `sides`, by truncated SVD.

    Where normals coincide (the end of a rolling-ball fillet) the distances alone leave the corner free to
    slide: `tangent` pairs add (n_a - n_b) . u = 0, divided by the relative curvature so that it is a length.
    A corner that runs away is solved again without the directions that its surfaces hardly determine. Where a
    chain is `resting` at the corner they are left out from the start.
    """
    if not sides:
        return Corner(start, 0.0, 0.0, 0.0)
    for rank in _RANKS[1:] if resting else _RANKS:
        corner = _gauss_newton(start, sides, tangent, rank)
        if corner.moved < _FAR:
            break
    return corner


def _gauss_newton(start: Array, sides: Sequence[Side], tangent: Sequence[tuple[Side, Side]], rank: float) -> Corner:
    """The solution in the directions whose singular values are above the share `rank` of the largest."""
    position = start.copy()
    small = 1e-8 if any(side.free for side in sides) else 1e-12
    for _ in range(_STEPS):
        values, rows = _residuals(position, sides, tangent)
        left, size, right = np.linalg.svd(rows, full_matrices=False)
        keep = size > rank * size[0]
        step = right[keep].T @ ((left[:, keep].T @ values) / size[keep])
        length = float(np.linalg.norm(step))
        position = position - step * min(1.0, _LONGEST_STEP / max(length, 1e-300))
        if length < small:
            break
    found, given = (_corner(at, start, sides, tangent) for at in (position, start))
    return found if found.residual <= given.residual else given


def _corner(
    position: Array, start: Array, sides: Sequence[Side], tangent: Sequence[tuple[Side, Side]]
) -> Corner:
    """A corner at `position` (3,), measured."""
    values, _ = _residuals(position, sides, tangent)
    distances = np.abs(values[: len(sides)])
    moved = float(np.linalg.norm(position - start))
    return Corner(position, float(distances.max()), float(np.abs(values).max()), moved)


def _residuals(position: Array, sides: Sequence[Side], tangent: Sequence[tuple[Side, Side]]) -> tuple[Array, Array]:
    """Lengths (m,) that vanish at the corner, and their gradients (m, 3)."""
    here = position[None]
    found = [side.primitive.distance_and_normal(here) for side in sides]
    values, rows = [float(distance[0]) for distance, _ in found], [normal[0] for _, normal in found]
    for a, b in tangent:
        contact = relative_curvature(a, b, here)
        if contact.curvature[0] < _LEAST_CURVATURE:
            continue
        values.append(float(contact.difference[0] @ contact.across[0]) / float(contact.curvature[0]))
        rows.append(contact.sideways[0])
    return np.array(values), np.array(rows)
