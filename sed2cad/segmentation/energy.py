"""One energy decides which primitive explains which point (PEARL: Isack and Boykov 2012).

    E(f) = sum_i D_i(f_i) + smoothness sum_ij w_ij [f_i != f_j] + sum_(primitives in use) cost

D is half the squared deviation in units of the noise, capped: a point that nothing explains pays the cap. On a CAD
system's mesh a point that a surface comes near pays extra where the vertices around it are not on that surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from sed2cad.primitives.base import Primitive
from sed2cad.segmentation.corners import EXACT, Corners

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

UNEXPLAINED = -1
COARSE = 0.12  # radians: deviation of the normals of a coarse tessellation, or of a scanner
BLUNT = 2.0  # price of a point that a surface only comes near
_TURNED = 2.0  # most that normals count where the vertices are on the surface: squared, in units of their deviation
_ACROSS = 0.7  # cosine of the normals from which they do


@dataclass(frozen=True)
class Tolerances:
    """What counts as one unit of deviation, and the prices of the energy."""

    distance: float  # unit frame: standard deviation of the points about their surface
    angle: float = COARSE  # radians: standard deviation of the normals
    cap: float = 6.0  # data cost of a point that no primitive explains
    smoothness: float = 0.6
    primitive: float = 14.0  # cost of using one more primitive


def data_cost(
    primitive: Primitive,
    sign: int,
    points: Array,
    normals: Array,
    tolerances: Tolerances,
    corners: Corners | None = None,
) -> Array:
    """D (n,) of each point under one primitive; corners of the points where they lie on a CAD system's mesh."""
    distance, there = primitive.distance_and_normal(points)
    return cost_of(primitive, distance, sign * there, normals, tolerances, corners)


def cost_of(
    primitive: Primitive,
    distance: Array,
    outwards: Array,
    normals: Array,
    tolerances: Tolerances,
    corners: Corners | None = None,
) -> Array:
    """The same from the distances (n,) of the points and the primitive's outward normals there (n, 3)."""
    square = (distance / tolerances.distance) ** 2
    if corners is not None and primitive.kind == "plane":
        normals = corners.normals
    cosine = np.einsum("ij,ij->i", outwards, normals)
    turn = 2 * (1 - cosine) / tolerances.angle**2  # angle^2 where it is small
    if corners is not None:
        off = (corners.off(primitive) / EXACT) ** 2
        turn = np.where((off < 2 * BLUNT) & (cosine > _ACROSS), np.minimum(turn, _TURNED), turn)
        square = np.minimum(off, square + 2 * BLUNT)
    return np.minimum(0.5 * (square + turn), tolerances.cap)


def reach(
    labels: Labels, cost: Array, adjacency: csr_matrix, beside: csr_matrix, cap: float, hops: int = 8
) -> NDArray[np.bool_]:
    """Which points (n, k) a primitive may claim: those it explains, within `hops` of its patch through such points,
    and one ring of any points beside the patch. adjacency, beside (n, n): not zero where two points are neighbours."""
    inlier = cost < cap
    held = np.zeros(cost.shape, dtype=np.float32)
    named = np.flatnonzero(labels >= 0)
    held[named, labels[named]] = 1.0
    links = (adjacency > 0).astype(np.float32)
    ring = ((beside > 0).astype(np.float32) @ held > 0) | (held > 0)
    for _ in range(hops):
        wider = ((links @ held > 0) & inlier) | (held > 0)
        if wider.sum() == (held > 0).sum():
            break
        held = wider.astype(np.float32)
    return (held > 0) | ring


def mean_field(cost: Array, adjacency: csr_matrix, smoothness: float, steps: int = 12) -> Labels:
    """Labels (n,) of least energy, approximately: mean-field annealing (Krähenbühl and Koltun 2011).

    cost (n, k), inf where a label is not allowed. Deterministic.
    """
    weights = adjacency.astype(np.float32)
    total = np.asarray(weights.sum(axis=1)).ravel()[:, None]
    finite = np.where(np.isfinite(cost), cost, 1e4).astype(np.float32)
    belief = _softmax(-finite)
    for temperature in np.geomspace(1.5, 0.15, steps):
        disagreement = total - weights @ belief
        belief = _softmax(-(finite + smoothness * disagreement) / np.float32(temperature))
    return belief.argmax(axis=1).astype(np.int64)


def _softmax(x: NDArray[np.float32]) -> NDArray[np.float32]:
    e = np.exp(x - x.max(axis=1, keepdims=True))
    return e / e.sum(axis=1, keepdims=True)
