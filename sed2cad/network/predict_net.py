"""SplineNet as a function: points of a patch in, base parameters for a least-squares fit out."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.layers import Layers
from sed2cad.network.spline_frame import CONTROLS, POINTS, patch_frame, spline_knots
from sed2cad.network.stored import SHIPPED_SPLINENET, SPLINE_FORMAT, stored_weights
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.tensor_patch import DEGREE
from sed2cad.primitives.unroll import Unrolled

Array = NDArray[np.float64]


def predicted_starts(points: Array, normals: Array) -> list[Unrolled]:
    """Parameters of points (n, 3) with unit normals (n, 3) on the predicted nets, open and closed, the nearer first.

    WeightsError where the shipped weights are damaged.
    """
    found = []
    for closed in (False, True):
        surface = predicted_net(points, normals, closed, _shipped())
        uv = surface.foot(points)
        gap = points - surface.at(uv)
        found.append((float(np.mean(gap**2)), _as_lengths(surface, uv)))
    return [start for _, start in sorted(found, key=lambda pair: pair[0])]


def predicted_net(points: Array, normals: Array, closed: bool, layers: Layers) -> NetSurface:
    """The net that SplineNet sees in a patch, its parameters in [0, 1]; the same one each time."""
    some = np.random.default_rng(0).choice(len(points), POINTS, replace=len(points) < POINTS)
    centre, axes, half = patch_frame(points[some])
    seen = np.hstack([(points[some] - centre) @ axes.T / half, normals[some] @ axes.T]).astype(np.float32)
    net = control_net(layers, seen, closed).astype(np.float64)
    if closed:
        net = np.concatenate([net, net[:DEGREE]])
    return NetSurface(closed, spline_knots(closed), spline_knots(False), centre + half * net @ axes)


def control_net(layers: Layers, points: NDArray[np.float32], closed: bool) -> NDArray[np.float32]:
    """SplineNet.forward of one patch (n, 6): (12, 12, 3)."""

    def pooled(x: NDArray) -> NDArray:
        return np.concatenate([x.max(axis=0), x.mean(axis=0)])[None]

    own = layers.mlp("point.1", layers.mlp("point.0", points))
    whole = np.broadcast_to(pooled(own), (len(own), 2 * own.shape[1]))
    mixed = layers.mlp("mix.1", layers.mlp("mix.0", np.hstack([own, whole])))
    head = f"heads.{int(closed)}"
    patch = layers.mlp(f"{head}.1", layers.mlp(f"{head}.0", pooled(mixed)))
    return layers.linear(f"{head}.2", patch).reshape(CONTROLS, CONTROLS, 3)


@cache
def _shipped() -> Layers:
    return Layers(stored_weights(SHIPPED_SPLINENET, SPLINE_FORMAT).arrays)


def _as_lengths(surface: NetSurface, uv: Array) -> Unrolled:
    """Parameters (n, 2) in [0, 1] times the mean lengths of the patch along u and v."""
    _, du, dv = surface.tangents(uv)
    along, across = (float(np.linalg.norm(d, axis=1).mean()) for d in (du, dv))
    return Unrolled(uv * [along, across], along if surface.closed else 0.0, 0.0)
