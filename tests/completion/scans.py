"""Scans that do not show all of a part, with the true patches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Scan


def seen(
    scan: Scan, fitted: list[FittedPatch], shown: NDArray[np.bool_]
) -> tuple[Scan, list[FittedPatch]]:
    """The points `shown` (n,) of a scan, and the patches that have some of them."""
    number = np.cumsum(shown) - 1
    found = []
    for patch in fitted:
        own = shown[patch.patch.indices]
        if own.any():
            kept = replace(
                patch.patch, indices=number[patch.patch.indices[own]], interior=patch.patch.interior[own]
            )
            found.append(replace(patch, patch=kept))
    return replace(scan, points=scan.points[shown], normals=scan.normals[shown]), found


def on_a_table(scan: Scan, fitted: list[FittedPatch]) -> tuple[Scan, list[FittedPatch]]:
    """Without the lowest faces that look down."""
    low = scan.points[:, 2] < scan.points[:, 2].min() + 1e-6
    return seen(scan, fitted, ~(low & (scan.normals[:, 2] < -0.9)))
