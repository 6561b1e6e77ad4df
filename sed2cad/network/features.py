"""Local geometric features of every point: what its neighbours at three scales say about the surface."""

from __future__ import annotations

import torch
from torch import Tensor

FEATURES = 58
"""10 of the point, 12 invariants per scale, 6 second moments of the normals at the two coarse scales."""
INVARIANT = torch.cat([torch.arange(10, 22), torch.arange(22, 34), torch.arange(40, 52)])
"""The columns that no rotation changes."""


def local_features(points: Tensor, normals: Tensor, neighbours: Tensor) -> Tensor:
    """Features (m, 58) of the first m points, from points and normals (n, 3) and neighbours (3, m, k).

    The point: x, n, n.x, x cross n (the normal lines of a cylinder meet its axis: Pottmann's line geometry).
    Each scale: see `_scale`; the coarse ones add the mean of n n'.
    """
    rows = neighbours.shape[1]
    p, n = points.T.contiguous(), normals.T.contiguous()
    own_p, own_n = p[:, :rows], n[:, :rows]
    parts = [own_p, own_n, (own_p * own_n).sum(0, keepdim=True), torch.linalg.cross(own_p, own_n, dim=0)]
    for scale, near in enumerate(neighbours):
        invariants, moments = _scale(p, n, near.T.contiguous())
        parts += [invariants, moments] if scale else [invariants]
    return torch.cat(parts).T.contiguous()


def _scale(p: Tensor, n: Tensor, near: Tensor) -> tuple[Tensor, Tensor]:
    """12 invariants and 6 moments, each (., m), from p, n (3, all points) and near (k, m).

    Invariants: mean distance r; mean and maximum of 1 - n.n'; mean, minimum, maximum of the offset from the
    tangent plane over r; the same of the normal curvature dx.dn / dx.dx (asinh); three of the
    normals' covariance.
    """
    k, rows = near.shape
    flat = near.reshape(-1)
    dx = p[:, flat].view(3, k, rows) - p[:, None, :rows]
    m = n[:, flat].view(3, k, rows)
    own = n[:, None, :rows]
    d2 = (dx * dx).sum(0)
    mean_d2 = d2.mean(0)
    r = mean_d2.sqrt() + 1e-6
    turn = 1 - (m * own).sum(0)
    height = (dx * own).sum(0)
    curvature = torch.asinh(0.5 * ((dx * m).sum(0) - height) / (d2 + 1e-3 * mean_d2 + 1e-9))
    height = height / r
    moments = torch.stack(
        [(m[i] * m[j]).mean(0) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    )
    lines = [r, turn.mean(0), turn.amax(0)]
    for value in (height, curvature):
        lines += [value.mean(0), value.amin(0), value.amax(0)]
    return torch.stack(lines + _covariance_invariants(m.mean(1), moments)), moments


def _covariance_invariants(mean: Tensor, moments: Tensor) -> list[Tensor]:
    """Roots of trace, second invariant and determinant of the normals' covariance, in units of a normal."""
    x, y, z = mean
    a, b, c = moments[0] - x * x, moments[1] - y * y, moments[2] - z * z
    d, e, f = moments[3] - x * y, moments[4] - x * z, moments[5] - y * z
    trace = (a + b + c).clamp_min(0)
    second = (a * b + a * c + b * c - d * d - e * e - f * f).clamp_min(0)
    determinant = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)).abs()
    return [trace.sqrt(), (second + 1e-12) ** 0.25, (determinant + 1e-12) ** (1 / 6)]
