"""The surface types that the network tells apart; a class id is an index into `PATCH_TYPES`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PATCH_TYPES = ("plane", "cylinder", "cone", "sphere", "torus", "bspline")
"""Open and closed B-splines are one class; the torus, frequent on real parts, has its own."""

PLANE, CYLINDER, CONE, SPHERE, TORUS, BSPLINE = range(len(PATCH_TYPES))

PAPER_TYPES = ("plane", "cylinder", "cone", "sphere", "open bspline", "closed bspline")
"""The paper's classes: as many, but the torus is a closed B-spline. A network has either (Architecture.torus)."""

PAPER_OPEN, PAPER_CLOSED = 4, 5


def paper_class(types: NDArray, closed: NDArray) -> NDArray[np.int8]:
    """Ids in PATCH_TYPES (n,), and whether the surface is closed (n,), to ids in PAPER_TYPES (n,)."""
    freeform = np.where(closed | (types == TORUS), PAPER_CLOSED, PAPER_OPEN)
    return np.where(types < TORUS, types, freeform).astype(np.int8)


def without_torus(types: NDArray) -> NDArray:
    """Ids in PATCH_TYPES (n,), tori as B-splines: what a network of PAPER_TYPES can be scored by."""
    return np.where(types == TORUS, BSPLINE, types).astype(types.dtype)


def from_paper(probabilities: NDArray) -> NDArray:
    """Probabilities (n, 6) of PAPER_TYPES to those of PATCH_TYPES; half the closed B-splines may be tori."""
    half = probabilities[:, PAPER_CLOSED] / 2
    return np.column_stack([probabilities[:, :TORUS], half, probabilities[:, PAPER_OPEN] + half])
