"""Splines that SplineNet predicts, and the frame in which it sees a patch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

CONTROLS = 12
"""Control points in each direction."""
POINTS = 512
"""Of a patch that the network sees."""
_DEGREE = 3


def patch_frame(points: NDArray) -> tuple[NDArray, NDArray, float]:
    """Centre (3,), principal directions (3, 3), rows, longest first, and the largest half extent of points (n, 3)."""
    centre = points.mean(axis=0)
    axes = np.linalg.eigh((points - centre).T @ (points - centre))[1][:, ::-1].T
    axes[2] *= np.sign(np.linalg.det(axes))
    local = (points - centre) @ axes.T
    return centre, axes, max(float(np.abs(local).max()), 1e-12)


def spline_knots(closed: bool) -> NDArray:
    """Knots over [0, 1]: uniform, with full ends or periodic."""
    if closed:
        return np.arange(-_DEGREE, CONTROLS + _DEGREE + 1) / CONTROLS
    spans = CONTROLS - _DEGREE
    return np.clip(np.arange(-_DEGREE, spans + _DEGREE + 1) / spans, 0, 1)


def spline_basis(at: NDArray, closed: bool) -> NDArray[np.float32]:
    """The CONTROLS basis functions (n, 12) at parameters (n,) in [0, 1]."""
    full = BSpline.design_matrix(np.clip(at, 0, 1), spline_knots(closed), _DEGREE).toarray()
    if closed:
        full[:, :_DEGREE] += full[:, CONTROLS:]
        full = full[:, :CONTROLS]
    return full.astype(np.float32)
