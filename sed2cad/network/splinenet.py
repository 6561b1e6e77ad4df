"""SplineNet: the control net of a freeform patch from its points, as a start for a least-squares fit.

Two networks on one encoder's features, one for open patches and one for patches that close along u, as in ParSeNet
(Sharma et al. 2020), which the paper takes its SplineNet from.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sed2cad.network.architecture import SplineShape
from sed2cad.network.edgeconv import Mlp
from sed2cad.network.spline_frame import CONTROLS, spline_knots


class SplineNet(nn.Module):
    """Points (b, n, 6) with normals, in the frame of `patch_frame`, to control nets (b, 12, 12, 3) in it."""

    def __init__(self, shape: SplineShape | None = None) -> None:
        super().__init__()
        self.shape = shape = shape or SplineShape()
        self.point = nn.Sequential(Mlp(6, shape.point // 2), Mlp(shape.point // 2, shape.point))
        self.mix = nn.Sequential(Mlp(3 * shape.point, shape.patch), Mlp(shape.patch, shape.patch))
        self.heads = nn.ModuleList(
            nn.Sequential(
                Mlp(2 * shape.patch, shape.head), Mlp(shape.head, shape.head), nn.Linear(shape.head, 3 * CONTROLS**2)
            )
            for _ in range(2)
        )
        for head, net in zip(self.heads, (_sheet(), _tube())):
            last = head[-1]  # type: ignore[index]
            with torch.no_grad():
                last.weight.mul_(0.1)
                last.bias.copy_(torch.from_numpy(net.ravel()))

    def forward(self, points: Tensor, closed: bool) -> Tensor:
        own = self.point(points)
        pooled = torch.cat([own.amax(1), own.mean(1)], -1)[:, None].expand(-1, own.shape[1], -1)
        mixed = self.mix(torch.cat([own, pooled], -1))
        patch = torch.cat([mixed.amax(1), mixed.mean(1)], -1)
        nets: Tensor = self.heads[int(closed)](patch).reshape(-1, CONTROLS, CONTROLS, 3)
        return nets


def _sheet() -> NDArray[np.float32]:
    """The net of the square [-1, 1]^2 in z = 0."""
    at = _greville(False)
    u, v = np.meshgrid(at, at, indexing="ij")
    return np.stack([u, v, 0 * u], axis=-1).astype(np.float32)


def _tube() -> NDArray[np.float32]:
    """The net of a tube of radius a half about x."""
    angle = 2 * np.pi * np.arange(CONTROLS) / CONTROLS
    angle, along = np.meshgrid(angle, _greville(False), indexing="ij")
    return np.stack([along, 0.5 * np.cos(angle), 0.5 * np.sin(angle)], axis=-1).astype(np.float32)


def _greville(closed: bool) -> NDArray:
    knots = spline_knots(closed)
    return 2 * (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3 - 1
