"""Flat pieces of a patch that no simple surface explains.

Planes that meet at a few degrees pass for one round face where the tolerance is that of a tessellation. The points of
a CAD system's mesh still lie on them exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sed2cad.components import linked
from sed2cad.segmentation.energy import UNEXPLAINED

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

_SAME = 1e-3  # radians between normals, at most, and
_LEVEL = 1e-5  # unit frame, between points and plane, of points on one plane
_MOST = 4  # planes: a round face has more facets
_NEARLY_ALL = 0.75  # share of the points


def flat_pieces(points: Array, normals: Array, fewest: int) -> Labels | None:
    """The plane (n,) that each of the points (n, 3) lies on, -1 for none; None where most lie on no few planes."""
    level = np.einsum("ij,ij->i", points, normals) / _LEVEL
    _, plane = linked(np.column_stack([normals / _SAME, level]), 1.0)
    names, found, count = np.unique(plane, return_inverse=True, return_counts=True)
    large = np.argsort(-count, kind="stable")[:_MOST]
    large = large[count[large] >= fewest]
    if len(large) < 2 or count[large].sum() < _NEARLY_ALL * len(points):
        return None
    number = np.full(len(names), -1)
    number[large] = np.arange(len(large))
    return np.asarray(number[found])


def with_flats(
    points: Array, normals: Array, labels: Labels, kinds: list[str], fewest: int
) -> tuple[Labels, list[str]]:
    """Labels (n,) and the kind of each, with planes instead of the freeform patches that are a few flat pieces."""
    labels, kinds = labels.copy(), list(kinds)
    for k in [k for k, kind in enumerate(kinds) if kind == "bspline"]:
        members = np.flatnonzero(labels == k)
        pieces = flat_pieces(points[members], normals[members], fewest)
        if pieces is None:
            continue
        labels[members] = np.where(pieces > 0, len(kinds) - 1 + pieces, np.where(pieces < 0, UNEXPLAINED, k))
        kinds[k] = "plane"
        kinds += ["plane"] * int(pieces.max())
    return labels, kinds
