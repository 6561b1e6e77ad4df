"""Faces without width: between two edges that run alike, or around a point, exact surfaces leave nothing.

A mesh shows them where a face is cut off by a neck that is narrower than its triangles, or where the faces at its ends
were missed.
"""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.curves import Line
from sed2cad.geometry.layout import Draft
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus

_NOTHING = 1e-6  # unit frame: length of an edge that has none
_ALIKE = 1e-5  # unit frame: distance of edges that are one
_PLACES = 25  # along two edges that are compared

Loop = list[tuple[int, int]]


def fold(draft: Draft) -> None:
    """Leave out edges without length and faces without width, whose neighbours then have one edge in common."""
    while _without_dots(draft) or _without_slits(draft) or _without_spikes(draft):
        pass


def _without_dots(draft: Draft) -> bool:
    """Leave out a straight edge without length; whether there was one."""
    for number in sorted({e for loops in draft.loops for loop in loops for e, _ in loop}):
        edge = draft.edges[number]
        if isinstance(edge.arc.curve, Line) and abs(edge.arc.last - edge.arc.first) < _NOTHING:
            draft.unite(edge.start, edge.end)
            draft.loops = [[[step for step in loop if step[0] != number] for loop in loops] for loops in draft.loops]
            draft.drop_empty()
            return True
    return False


def _without_slits(draft: Draft) -> bool:
    """Make one edge of two that bound nothing; whether there were such."""
    for region, loops in enumerate(draft.loops):
        if isinstance(draft.primitive(region), Sphere | Torus):  # two edges may bound nearly all of it
            continue
        for loop in loops:
            if len(loop) == 2 and loop[0][0] != loop[1][0] and _alike(draft, loop):
                (kept, way), (gone, back) = loop
                loops.remove(loop)
                draft.drop_empty()
                steps = {(gone, -back): (kept, way)}
                draft.loops = [[[steps.get(s, s) for s in loop] for loop in loops] for loops in draft.loops]
                return True
    return False


def _without_spikes(draft: Draft) -> bool:
    """Leave out what a loop goes there and back; whether there was such a thing."""
    for loops in draft.loops:
        for loop in loops:
            for k, (edge, way) in enumerate(loop):
                if loop[k - 1] == (edge, -way) and len(loop) > 1:
                    for place in sorted((k, (k - 1) % len(loop)), reverse=True):
                        del loop[place]
                    draft.drop_empty()
                    return True
    return False


def _alike(draft: Draft, loop: Loop) -> bool:
    """Whether two edges go there and back on one way."""
    (first, way), (second, back) = loop
    one, two = draft.edges[first], draft.edges[second]
    if one.start < 0 or two.start < 0 or {one.start, one.end} != {two.start, two.end}:
        return False
    there, again = one.arc.sampled(_PLACES)[::way], two.arc.sampled(_PLACES)[::-back]
    return bool(np.abs(there - again).max() < _ALIKE)
