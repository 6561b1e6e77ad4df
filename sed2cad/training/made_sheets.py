"""Random freeform patches whose parameters are known: bent sheets, and tubes around bent spines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.spline_frame import CONTROLS, spline_basis

_WAVES = 3  # frequencies


@dataclass(frozen=True)
class Sheet:
    """Points of a patch with their parameters."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3) unit
    uv: NDArray[np.float32]  # (n, 2) in [0, 1]
    closed: bool  # in u


def made_sheet(rng: np.random.Generator, count: int, closed: bool) -> Sheet:
    """A random control net, sampled uniformly in its parameters."""
    net = (_tube_net if closed else _sheet_net)(rng)
    uv = rng.random((count, 2))
    step = 1e-3
    points = _at(net, uv, closed)
    inner = step + (1 - 2 * step) * uv
    along = _at(net, inner + np.array([step, 0]), closed) - _at(net, inner, closed)
    across = _at(net, inner + np.array([0, step]), closed) - _at(net, inner, closed)
    normals = np.cross(along, across)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Sheet(points.astype(np.float32), normals.astype(np.float32), uv.astype(np.float32), closed)


def _at(net: NDArray, uv: NDArray, closed: bool) -> NDArray:
    rows = spline_basis(uv[:, 0], closed) @ net.reshape(CONTROLS, -1).astype(np.float32)
    return np.einsum("nv,nvk->nk", spline_basis(uv[:, 1], False), rows.reshape(-1, CONTROLS, 3)).astype(np.float64)


def _curve(rng: np.random.Generator, bend: float) -> tuple[NDArray, NDArray]:
    """A smooth curve of length 1 (12, 3), and the directions across it that twist least (12, 2, 3)."""
    at = np.linspace(0, 1, CONTROLS)
    way = np.array([1.0, 0, 0]) + sum(
        bend * rng.normal(size=3) / k * np.cos(np.pi * k * at + rng.uniform(0, 2 * np.pi))[:, None]
        for k in range(1, _WAVES + 1)
    )
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    frames, x = np.empty((CONTROLS, 2, 3)), np.cross(way[0], rng.normal(size=3))
    for k, tangent in enumerate(way):
        x = x - (x @ tangent) * tangent
        x = x / np.linalg.norm(x)
        frames[k] = x, np.cross(tangent, x)
    return np.cumsum(way, axis=0) / CONTROLS, frames


def _sheet_net(rng: np.random.Generator) -> NDArray:
    """A cross-section swept along a curve, twisted, and waves on it."""
    spine, frames = _curve(rng, rng.uniform(0, 1.2))
    width, arch = rng.uniform(0.1, 1.0), rng.uniform(-2.5, 2.5)
    across = np.linspace(-0.5, 0.5, CONTROLS)
    section = np.column_stack([np.sinc(arch / np.pi * across) * across, (1 - np.cos(arch * across)) / (arch or 1.0)])
    twist = rng.normal() * np.linspace(-1, 1, CONTROLS)
    turned = np.stack(
        [
            np.cos(twist)[:, None] * section[:, 0] - np.sin(twist)[:, None] * section[:, 1],
            np.sin(twist)[:, None] * section[:, 0] + np.cos(twist)[:, None] * section[:, 1],
        ],
        axis=-1,
    )
    net = spine[:, None] + width * np.einsum("uvc,uck->uvk", turned, frames)
    u, v = np.meshgrid(np.linspace(0, np.pi, CONTROLS), np.linspace(0, np.pi, CONTROLS), indexing="ij")
    wave = rng.uniform(0, 0.06) * np.cos(rng.integers(0, 4) * u) * np.cos(rng.integers(0, 4) * v)
    return net + wave[:, :, None] * rng.normal(size=3)


def _tube_net(rng: np.random.Generator) -> NDArray:
    """Lobed rings along a curve."""
    spine, frames = _curve(rng, rng.uniform(0, 0.8))
    angle = 2 * np.pi * np.arange(CONTROLS) / CONTROLS
    ring = 1 + rng.uniform(0, 0.2) * np.cos(rng.integers(2, 5) * angle + rng.uniform(0, 2 * np.pi))
    ratio = rng.uniform(0.4, 1.0)
    section = np.column_stack([ring * np.cos(angle), ratio * ring * np.sin(angle)])
    size = rng.uniform(0.05, 0.6) * (1 + rng.uniform(0, 0.4) * np.cos(np.linspace(0, rng.uniform(0, 6), CONTROLS)))
    return spine[None] + np.einsum("v,uc,vck->uvk", size, section, frames)
