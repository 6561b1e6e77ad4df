"""Labelled clouds whose truth is known in closed form."""

import numpy as np

from sed2cad.training.labelled_part import LabelledCloud


def cube(points=3_000, seed=0):
    """The six sides of a cube of side 1, each a patch, points in random order."""
    rng = np.random.default_rng(seed)
    side = np.arange(points) % 6
    places, normals = rng.random((points, 3)) - 0.5, np.zeros((points, 3))
    outward = np.where(side % 2, 0.5, -0.5)
    places[np.arange(points), side // 2] = outward
    normals[np.arange(points), side // 2] = 2 * outward
    gap = np.sort(0.5 - np.abs(places), axis=1)[:, 1]
    order = rng.permutation(points)
    return LabelledCloud(
        places[order].astype(np.float32),
        normals[order].astype(np.float32),
        normals[order].astype(np.float16),
        side[order].astype(np.int16),
        np.zeros(points, np.int8),
        np.minimum(gap, 0.1)[order].astype(np.float16),
    )
