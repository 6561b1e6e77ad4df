"""One primitive is the image of another: turned about an axis, shifted along one, or mirrored in a plane.

The map hangs on a third member of the relation, its datum. So every relation of a bolt circle, a row or a
symmetry is one equation, whatever the kind of the primitives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sed2cad.primitives.relations import SAME, Placed, Stack, dot

# vectors (n, 3), datum (n,), number (n,) -> their images
Map = Callable[[Stack, Placed, Stack], Stack]


@dataclass(frozen=True)
class Image:
    """The equation "q is the image of p by the datum d": as many residuals as two surfaces need to be one.

    The number is the angle of the turn, or how many times the pitch the shift is.
    """

    kind: str  # of both primitives
    turn: Map  # of directions
    move: Map  # of points

    def __call__(self, p: Placed, q: Placed, d: Placed, number: Stack) -> Stack:
        direction = self.turn(p.direction, d, number)
        if self.kind == "plane":
            point = self.move(p.size[:, None] * p.direction, d, number)
            offset = dot(direction, point) - dot(direction, q.direction) * q.size
            return np.column_stack([np.cross(direction, q.direction), offset])
        position = self.move(p.position, d, number)
        image = Placed(np.column_stack([direction, position, p.size, p.second]))
        return SAME[self.kind](image, q, 1 + 0 * number)


def _turned(vectors: Stack, axis: Placed, angle: Stack) -> Stack:
    """Rodrigues' formula."""
    k, cosine = axis.direction, np.cos(angle)[:, None]
    along = dot(k, vectors)[:, None] * k
    return np.asarray(cosine * vectors + np.sin(angle)[:, None] * np.cross(k, vectors) + (1 - cosine) * along)


def _turned_points(points: Stack, axis: Placed, angle: Stack) -> Stack:
    return np.asarray(axis.position + _turned(points - axis.position, axis, angle))


def _kept(vectors: Stack, pitch: Placed, times: Stack) -> Stack:
    return vectors


def _shifted(points: Stack, pitch: Placed, times: Stack) -> Stack:
    """By multiples of a cylinder's radius along its axis."""
    return np.asarray(points + (times * pitch.size)[:, None] * pitch.direction)


def _reflected(vectors: Stack, plane: Placed, number: Stack) -> Stack:
    return np.asarray(vectors - 2 * dot(plane.direction, vectors)[:, None] * plane.direction)


def _mirrored(points: Stack, plane: Placed, number: Stack) -> Stack:
    height = dot(plane.direction, points) - plane.size
    return np.asarray(points - 2 * height[:, None] * plane.direction)


TURNED = {kind: Image(kind, _turned, _turned_points) for kind in SAME}
SHIFTED = {kind: Image(kind, _kept, _shifted) for kind in SAME}
MIRRORED = {kind: Image(kind, _reflected, _mirrored) for kind in SAME}


def on_circle(p: Placed, q: Placed, number: Stack) -> Stack:
    """The axis of q runs in the cylinder p."""
    apart = np.cross(q.position - p.position, p.direction)
    return np.asarray((np.sqrt(dot(apart, apart)) - p.size)[:, None])
