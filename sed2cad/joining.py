"""Freeform patches side by side that are one swept surface: the segmentation cannot know, the fits can."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sed2cad.fitting import parameter_count
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.robust_fit import FINEST
from sed2cad.primitives.swept_choice import Explained, swept_instead
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.neighbours import nearest
from sed2cad.scan.scan import Scan

_NEIGHBOURS = 6
_SMOOTH = np.cos(np.radians(20.0))  # between the normals of neighbours across a border that is none
_LEAST_PAIRS = 6  # of neighbours across it
_LEAST_SHARE = 0.6  # of these that are smooth
_MOST_TRIALS = 40
_POOR = 3.0  # times the noise: rms of an analytic surface that does not explain its points

Pair = tuple[int, int]


def joined(scan: Scan, fitted: Sequence[FittedPatch]) -> list[FittedPatch]:
    """The patches in order, freeform neighbours that one profile sweeps as one in the place of the first.

    An analytic neighbour may join them where its surface does not explain its points.
    They must go on smoothly across their border, and one surface must explain them at no higher cost than theirs.
    """
    patches: list[FittedPatch | None] = list(fitted)
    poor = _POOR * max(scan.noise, FINEST)
    free = [k for k, patch in enumerate(fitted) if patch.patch.kind == "bspline" or patch.rms > poor]
    owner = np.full(len(scan.points), -1)
    for k in free:
        owner[fitted[k].patch.indices] = k
    tried: set[Pair] = set()
    for _ in range(_MOST_TRIALS if len(free) > 1 else 0):
        pairs = [pair for pair in _borders(scan, owner) if pair not in tried]
        if not pairs:
            break
        a, b = pairs[0]
        tried.add((a, b))
        one, other = patches[a], patches[b]
        assert one is not None and other is not None
        union = _union(scan, one, other) if one.primitive.freeform or other.primitive.freeform else None
        if union is not None:
            patches[a], patches[b] = union, None
            owner[other.patch.indices] = a
            tried = {pair for pair in tried if a not in pair}
    return [patch for patch in patches if patch is not None]


def _borders(scan: Scan, owner: NDArray[np.int64]) -> list[Pair]:
    """Pairs of patches (a < b) with a smooth border, the longest first; owner (n,) of each point, -1 for none."""
    own = np.flatnonzero(owner >= 0)
    if len(own) <= _NEIGHBOURS:
        return []
    _, near = nearest(scan.points[own], _NEIGHBOURS)
    here, there = np.repeat(own, _NEIGHBOURS), own[near.ravel()]
    across = owner[here] != owner[there]
    here, there = here[across], there[across]
    smooth = np.einsum("ij,ij->i", scan.normals[here], scan.normals[there]) > _SMOOTH
    sides = np.sort(np.column_stack([owner[here], owner[there]]), axis=1)
    every = Counter(map(tuple, sides.tolist()))
    fine = Counter(map(tuple, sides[smooth].tolist()))
    long = [pair for pair, count in fine.items() if count >= max(_LEAST_PAIRS, _LEAST_SHARE * every[pair])]
    return sorted(((a, b) for a, b in long), key=lambda pair: (-fine[pair], pair))


def _union(scan: Scan, one: FittedPatch, other: FittedPatch) -> FittedPatch | None:
    """Both patches on one swept or simpler surface, where there is one."""
    pieces = []
    for patch in (one, other):
        own = patch.patch.indices
        numbers = parameter_count(patch.primitive)
        pieces.append(Explained(patch.primitive, numbers, scan.points[own], scan.normals[own]))
    found = swept_instead(pieces, scan.noise)
    if found is None:
        return None
    primitive, covariance = found
    indices = np.concatenate([one.patch.indices, other.patch.indices])
    interior = np.concatenate([one.patch.interior, other.patch.interior])
    points, normals = scan.points[indices], scan.normals[indices]
    rms = root_mean_square(primitive.distance(points))
    whole = Patch(indices, "bspline", interior)
    return FittedPatch(whole, primitive, primitive.side(points, normals), rms, covariance)
