"""Points that belong to no surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.scan import Array

COUNT = 10
"""Neighbours whose mean distance says how lonely a point is."""
LOCAL = 2.2
"""An outlier lies this many times farther from its neighbours than they lie from theirs (6 sigma for even
scans)."""
GLOBAL = 4.0
"""or this many times farther than nine tenths of all points: outliers that are each other's neighbours."""
MOST = 0.05
"""More than this share are no outliers, but the way the scan was taken; then all points stay."""


def inliers(distance: Array, near: NDArray) -> NDArray[np.bool_]:
    """True (n,) for the points to keep, from the distances (n, COUNT) to their nearest neighbours and the
    indices.
    """
    lonely = distance.mean(axis=1)
    usual = np.median(lonely[near], axis=1)
    keep = (lonely <= LOCAL * usual) & (lonely <= GLOBAL * np.quantile(lonely, 0.9))
    return keep if keep.mean() >= 1 - MOST else np.ones(len(keep), dtype=bool)
