"""What a scan does to a clean cloud, and rigid motions, mirrors and scales that leave its labels alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MAX_NOISE = 0.04
"""Largest displacement along the normal, in radii of the bounding sphere (the paper's Table 3)."""
MAX_TURN = 5.0
"""Largest turn of a noisy normal, degrees (the paper's Table 3)."""
LEAST_KEPT = 0.3
"""Share of a cloud that missing regions leave at least."""
CORNERS = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(8, 3)
PIXEL = 0.018
"""Of the depth picture that decides what a view sees, in tangents of the view's angle."""


def noise(points: NDArray, normals: NDArray, rng: np.random.Generator) -> NDArray:
    """Points (n, 3) moved along their normals, small noise more often than large."""
    amplitude = MAX_NOISE * np.linalg.norm(points, axis=1).max() * rng.random() ** 2
    return points + normals * rng.uniform(-amplitude, amplitude, (len(points), 1))


def turn(normals: NDArray, degrees: float, rng: np.random.Generator) -> NDArray:
    """Turn each unit normal by up to `degrees` about a random axis."""
    side = np.cross(normals, rng.normal(size=normals.shape))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-30)
    angle = np.radians(rng.uniform(-degrees, degrees, (len(normals), 1)))
    return normals * np.cos(angle) + side * np.sin(angle)


def estimate_normals(points: NDArray, towards: NDArray, near: NDArray) -> NDArray:
    """Least-squares plane normals (n, 3) of the points `near` (n, k) each, on the side of `towards`."""
    local = points[near]
    local = local - local.mean(1, keepdims=True)
    _, axes = np.linalg.eigh(local.transpose(0, 2, 1) @ local)
    return on_the_side_of(axes[:, :, 0], towards)


def on_the_side_of(normals: NDArray, towards: NDArray) -> NDArray:
    """Normals (n, 3), each turned round where it opposes `towards`."""
    return normals * np.where(np.einsum("ij,ij->i", normals, towards) < 0, -1, 1)[:, None]


def flip_patch(normals: NDArray, patch: NDArray, rng: np.random.Generator) -> NDArray:
    """Normals with those of one random patch turned round: how orientation by propagation goes wrong."""
    return np.where((patch == rng.choice(patch))[:, None], -normals, normals)


def missing_regions(points: NDArray, normals: NDArray, rng: np.random.Generator) -> NDArray[np.bool_]:
    """What a scan sees (n,): all but 1 to 3 balls or half-spaces, or what shows from 3 to 4 corners of the box."""
    if rng.random() < 0.4:
        views = rng.permutation(8)[: rng.integers(3, 5)]
        seen = np.any([visible(points, normals, corner) for corner in 1.2 * CORNERS[views]], axis=0)
        return seen if seen.mean() > LEAST_KEPT else np.ones(len(points), bool)
    kept = np.ones(len(points), bool)
    for _ in range(rng.integers(1, 4)):
        if rng.random() < 0.7:
            far = np.linalg.norm(points - rng.choice(points), axis=1) > rng.uniform(0.05, 0.3)
        else:
            height = points @ rng.normal(size=3)
            far = height < np.quantile(height, rng.uniform(0.6, 0.95))
        if (kept & far).mean() > LEAST_KEPT:
            kept &= far
    return kept


def visible(points: NDArray, normals: NDArray, eye: NDArray) -> NDArray[np.bool_]:
    """Points (n,) that face the eye (3,) and are the nearest in their pixel of its depth picture."""
    ray = eye - points
    distance = np.linalg.norm(ray, axis=1)
    facing = np.einsum("ij,ij->i", ray, normals) > 0.1 * distance
    axis = eye / np.linalg.norm(eye)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    depth = ray @ axis
    picture = np.column_stack([ray @ side, ray @ np.cross(axis, side)]) / np.maximum(depth, 1e-3)[:, None]
    column, row = np.floor(picture / PIXEL).astype(np.int64).clip(-500, 499).T + 500
    pixel = column * 1_000 + row
    nearest = np.full(1_000_000, np.inf)
    np.minimum.at(nearest, pixel, distance)
    return facing & (distance < nearest[pixel] + 2 * PIXEL * distance)


def density(points: NDArray, normals: NDArray, rng: np.random.Generator) -> NDArray:
    """How likely each point is measured (n,): by a linear or a wavy field, or by its angle to a view."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    match rng.integers(3):
        case 0:
            return np.exp(rng.uniform(1, 4) * points @ direction)
        case 1:
            return np.exp(rng.uniform(0.5, 1.5) * np.sin(rng.uniform(4, 15) * points @ direction + rng.uniform(0, 6)))
        case _:
            return np.abs(normals @ direction) + 0.08


def thin_out(weight: NDArray, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """`count` different rows in random order, drawn with weights (n,) (Efraimidis and Spirakis, 2006)."""
    keys = np.log(weight) + rng.gumbel(size=len(weight))
    return rng.permutation(np.argpartition(-keys, min(count, len(keys) - 1))[:count])


def random_motion(rng: np.random.Generator) -> NDArray[np.float32]:
    """(3, 3): a rotation (half of them by right angles), half of them mirrored, times a scale 0.8 to 1.1."""
    if rng.random() < 0.5:
        matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        matrix *= rng.choice([-1, 1], 3)
    else:
        matrix = np.zeros((3, 3))
        matrix[np.arange(3), rng.permutation(3)] = rng.choice([-1, 1], 3)
    return (matrix * rng.uniform(0.8, 1.1)).astype(np.float32)
