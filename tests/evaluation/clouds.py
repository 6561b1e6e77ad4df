"""Labelled clouds and parts whose truth is known in closed form."""

import numpy as np

from sed2cad.training.labelled_part import EDGE_UNIT, LabelledCloud, LabelledPart


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
        np.zeros(points, bool),
    )


def box(height=1.0):
    """A part: a box 1 x 1 x height, a patch on each of its six sides in the order of `cube`."""
    unit = np.indices((2, 2, 2)).reshape(3, 8).T - 0.5
    corners = unit * [1, 1, height]
    axes, outward = np.repeat(np.eye(3), 2, 0), np.tile([-1, 1], 3)
    triangles = []
    for axis, sign in zip(axes.argmax(1), outward):
        side = np.flatnonzero(unit[:, axis] * sign > 0)  # corners 00, 01, 10, 11 of the other two axes
        triangles += [side[list(t)][:: sign * (-1 if axis == 1 else 1)] for t in ((0, 2, 3), (0, 3, 1))]
    a, b = np.nonzero(np.triu(np.abs(unit[:, None] - unit).sum(2) == 1))
    return LabelledPart(
        nodes=corners.astype(np.float32),
        normals=np.zeros((8, 3), np.int16),
        triangles=np.array(triangles).astype(np.uint16),
        face=np.repeat(np.arange(6), 2).astype(np.uint16),
        patch=np.arange(6).astype(np.int16),
        type=np.zeros(6, np.int8),
        closed=np.zeros(6, bool),
        disguised=np.zeros(6, bool),
        side=np.ones(6, np.int8),
        origin=axes * outward[:, None] * [0.5, 0.5, height / 2],
        axis=axes * outward[:, None],
        radii=np.zeros((6, 2)),
        edges=np.rint(np.stack([corners[a], corners[b]], 1).reshape(-1, 3) / EDGE_UNIT).astype(np.int16),
        edge_start=np.arange(0, 24, 2).astype(np.uint16),
    )
