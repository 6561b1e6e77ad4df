"""Pieces of a freeform face, which the segmentation cut up, become one patch again: only fits can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sed2cad.components import components
from sed2cad.fitting import parameter_count
from sed2cad.primitives.base import FittedPatch
from sed2cad.primitives.robust_fit import FINEST
from sed2cad.primitives.swept_choice import Explained, swept_instead
from sed2cad.scan.neighbours import nearest
from sed2cad.scan.scan import Scan
from sed2cad.skins import skin, whole

_NEIGHBOURS = 6
_SMOOTH = np.cos(np.radians(20.0))  # between the normals of neighbours across a border that is none
_LEAST_PAIRS = 6  # of neighbours across it
_LEAST_SHARE = 0.6  # of these that are smooth
_MOST_TRIALS = 20
_POOR = 1.5  # times the noise: rms of an analytic surface that does not explain its points,
_SEEN = 1.0  # and times what a tessellation leaves; that of 97 in 100 faces that are analytic is less
_EXACT = 0.1  # of what a tessellation leaves: an analytic face of a fine one

Pair = tuple[int, int]


def joined(scan: Scan, fitted: Sequence[FittedPatch]) -> list[FittedPatch]:
    """The patches in order, pieces of a freeform face as one in the place of the first.

    A piece is freeform, or analytic and does not explain its points, or lies with such a one on a part of a mesh that
    sharp edges bound. Pieces must go on smoothly across their borders, and one surface must explain them at no higher
    cost than theirs: first all that hang together, then two by two.
    """
    patches: list[FittedPatch | None] = list(fitted)
    limit = max(_POOR * scan.noise, _SEEN * FINEST)
    poor = [k for k, patch in enumerate(fitted) if patch.patch.kind == "bspline" or patch.rms > limit]
    owner = np.full(len(scan.points), -1)
    for k in poor:
        owner[fitted[k].patch.indices] = k
    for group in _on_parts(scan, fitted, poor):
        _join(scan, patches, owner, group)
    for group in _groups(scan, owner):
        _join(scan, patches, owner, group)
    tried: set[Pair] = set()
    for _ in range(_MOST_TRIALS):
        pairs = [pair for pair in _borders(scan, owner) if pair not in tried]
        if not pairs:
            break
        tried.add(pairs[0])
        if _join(scan, patches, owner, pairs[0]):
            tried = {pair for pair in tried if pairs[0][0] not in pair}
    return [patch for patch in patches if patch is not None]


def _on_parts(scan: Scan, fitted: Sequence[FittedPatch], poor: Sequence[int]) -> list[list[int]]:
    """Patches that share a part of the mesh with others, some of them poor; none that its triangles lie on exactly."""
    if scan.part is None:
        return []
    part = [int(np.bincount(scan.part[patch.patch.indices]).argmax()) for patch in fitted]
    sure = [patch.primitive.kind == "plane" or patch.rms < _EXACT * FINEST for patch in fitted]
    groups = [
        [k for k, own in enumerate(part) if own == p and not sure[k]] for p in sorted({part[k] for k in poor})
    ]
    return [group for group in groups if len(group) > 1]


def _groups(scan: Scan, owner: NDArray[np.int64]) -> list[list[int]]:
    """Patches that hang together over smooth borders; owner (n,) of each point, -1 for none."""
    pairs = np.array(_borders(scan, owner), dtype=np.int64).reshape(-1, 2)
    number, group = components(int(owner.max(initial=-1)) + 1, pairs)
    used = np.unique(owner[owner >= 0])
    return [found.tolist() for n in range(number) if len(found := used[group[used] == n]) > 1]


def _join(
    scan: Scan, patches: list[FittedPatch | None], owner: NDArray[np.int64], group: Sequence[int]
) -> bool:
    """Whether some patches could be joined: the first becomes all of them, the others None."""
    pieces = [patch for k in group if (patch := patches[k]) is not None]
    union = (_swept(scan, pieces) if any(p.primitive.freeform for p in pieces) else None) or skin(scan, pieces)
    if union is None:
        return False
    for k in group:
        patches[k] = None
    patches[group[0]] = union
    owner[union.patch.indices] = group[0]
    return True


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


def _swept(scan: Scan, pieces: Sequence[FittedPatch]) -> FittedPatch | None:
    """All pieces on one swept or simpler surface, where there is one."""
    explained = []
    for piece in pieces:
        own = piece.patch.indices
        numbers = parameter_count(piece.primitive)
        explained.append(Explained(piece.primitive, numbers, scan.points[own], scan.normals[own]))
    found = swept_instead(explained, scan.noise)
    return None if found is None else whole(scan, pieces, *found)
