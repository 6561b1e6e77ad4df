"""SplineNet as a function: points of a patch in, base parameters for a least-squares fit out."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.tensor_patch import DEGREE
from sed2cad.primitives.unroll import Unrolled

if TYPE_CHECKING:
    from sed2cad.network.splinenet import SplineNet

Array = NDArray[np.float64]


def predicted_starts(points: Array, normals: Array) -> list[Unrolled]:
    """Parameters of points (n, 3) with unit normals (n, 3) on the predicted nets, open and closed, the nearer first.

    torch is imported when this is called first. WeightsError where the shipped weights are damaged.
    """
    found = []
    for closed in (False, True):
        surface = predicted_net(points, normals, closed, _shipped())
        uv = surface.foot(points)
        gap = points - surface.at(uv)
        found.append((float(np.mean(gap**2)), _as_lengths(surface, uv)))
    return [start for _, start in sorted(found, key=lambda pair: pair[0])]


def predicted_net(points: Array, normals: Array, closed: bool, network: SplineNet) -> NetSurface:
    """The net that the network sees in a patch, its parameters in [0, 1]; the same one each time."""
    import torch

    from sed2cad.network.splinenet import POINTS, patch_frame, spline_knots

    some = np.random.default_rng(0).choice(len(points), POINTS, replace=len(points) < POINTS)
    centre, axes, half = patch_frame(points[some])
    seen = np.hstack([(points[some] - centre) @ axes.T / half, normals[some] @ axes.T]).astype(np.float32)
    with torch.no_grad():
        net = network(torch.from_numpy(seen)[None], closed)[0].numpy().astype(np.float64)
    if closed:
        net = np.concatenate([net, net[:DEGREE]])
    return NetSurface(closed, spline_knots(closed), spline_knots(False), centre + half * net @ axes)


@cache
def _shipped() -> SplineNet:
    from sed2cad.network.weights import load_splinenet

    return load_splinenet()


def _as_lengths(surface: NetSurface, uv: Array) -> Unrolled:
    """Parameters (n, 2) in [0, 1] times the mean lengths of the patch along u and v."""
    _, du, dv = surface.tangents(uv)
    along, across = (float(np.linalg.norm(d, axis=1).mean()) for d in (du, dv))
    return Unrolled(uv * [along, across], along if surface.closed else 0.0, 0.0)
