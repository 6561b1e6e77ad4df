"""Training samples: a labelled cloud in random order with its neighbours, in variants cached on disk."""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sed2cad.network.graph import neighbour_graph
from sed2cad.training.augment import perturb
from sed2cad.training.dataset import load_cloud

EDGE_DISTANCE = 7e-3
"""A point is an edge point when it lies this near to a true edge, longest side 1 (the paper, section 4)."""
VARIANTS = 3
"""Per part: two clean ones (exact or facet normals) and one, the last, with noise."""
MIN_POINTS = 3_000
"""Noisy variants hold between this many and all points, so that the network sees several densities."""


@dataclass(frozen=True)
class Sample:
    """One cloud as the network sees it, n points in random order."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3)
    neighbours: NDArray[np.uint16]  # (3, n, k), see neighbour_graph
    patch: NDArray[np.int16]  # (n,)
    type: NDArray[np.int8]  # (n,)
    edge: NDArray[np.bool_]  # (n,)


def load_sample(path: Path, variant: int) -> Sample:
    """The given variant of a packed part; made on first use and cached in a folder beside the part."""
    cache = path.parent / "cache" / f"{path.stem}_{variant}.npz"
    try:
        with np.load(cache, allow_pickle=False) as arrays:
            return Sample(**{name: arrays[name] for name in Sample.__dataclass_fields__})
    except (OSError, ValueError, KeyError):  # absent or half-written
        sample = make_sample(path, variant)
        cache.parent.mkdir(exist_ok=True)
        with cache.open("wb") as stream:
            np.savez(stream, **asdict(sample))
        return sample


def make_sample(path: Path, variant: int) -> Sample:
    """The given variant of a packed part, the same each time it is asked for."""
    cloud = load_cloud(path)
    rng = np.random.default_rng([zlib.crc32(path.stem.encode()), variant])
    order = rng.permutation(len(cloud.points))
    if variant == VARIANTS - 1:
        points, normals = perturb(cloud, rng)
        order = order[: max(MIN_POINTS, int(len(order) * min(1.0, rng.uniform(0.3, 1.7))))]
    else:
        points = cloud.points
        normals = cloud.normals if rng.random() < 0.5 else cloud.facet_normals.astype(np.float32)
    points = points[order]
    return Sample(
        points,
        normals[order],
        neighbour_graph(points),
        cloud.patch[order],
        cloud.type[order],
        cloud.edge_distance[order] < EDGE_DISTANCE,
    )
