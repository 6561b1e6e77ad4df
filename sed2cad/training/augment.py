"""What a scan does to a clean cloud, and rigid motions, mirrors and scales that leave its labels alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.training.labelled_part import LabelledCloud

MAX_NOISE = 0.04
"""Largest displacement along the normal, in radii of the bounding sphere (the paper's Table 3)."""
MAX_TURN = 5.0
"""Largest turn of a noisy normal, degrees (the paper's Table 3)."""


def perturb(cloud: LabelledCloud, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Noisy points and normals, small noise more often than large; half the normals are estimated."""
    normals: NDArray = cloud.normals
    radius = np.linalg.norm(cloud.points, axis=1).max()
    amplitude = MAX_NOISE * radius * rng.random() ** 2
    points = cloud.points + normals * rng.uniform(-amplitude, amplitude, (len(normals), 1))
    if rng.random() < 0.5:
        normals = turn(normals, MAX_TURN * rng.random(), rng)
    else:
        normals = estimate_normals(points, normals, int(rng.integers(6, 21)))
    return points.astype(np.float32), normals.astype(np.float32)


def turn(normals: NDArray, degrees: float, rng: np.random.Generator) -> NDArray:
    """Turn each unit normal by up to `degrees` about a random axis."""
    side = np.cross(normals, rng.normal(size=normals.shape))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-30)
    angle = np.radians(rng.uniform(-degrees, degrees, (len(normals), 1)))
    return normals * np.cos(angle) + side * np.sin(angle)


def estimate_normals(points: NDArray, towards: NDArray, k: int) -> NDArray:
    """Least-squares plane normals of the k nearest points, on the side of `towards`."""
    near = points[cKDTree(points).query(points, k=k)[1]]
    near = near - near.mean(1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
    normals = axes[:, :, 0]
    return normals * np.where((normals * towards).sum(1, keepdims=True) < 0, -1, 1)


def random_motion(rng: np.random.Generator) -> NDArray[np.float32]:
    """(3, 3): a rotation (half of them by right angles), half of them mirrored, times a scale 0.8 to 1.1."""
    if rng.random() < 0.5:
        matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        matrix *= rng.choice([-1, 1], 3)
    else:
        matrix = np.zeros((3, 3))
        matrix[np.arange(3), rng.permutation(3)] = rng.choice([-1, 1], 3)
    return (matrix * rng.uniform(0.8, 1.1)).astype(np.float32)
