"""Directions of extrusions and axes of revolution that follow those of the planes, cylinders, ... of the part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sed2cad.primitives.base import Array, FittedPatch
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.extrusion import Extrusion, across
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.robust_fit import UNSEEN
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import root_mean_square, unit

_ANGLES = np.radians([0.3, 2.0])  # three standard deviations of a direction, within these limits
_SHIFTS = (5e-4, 5e-3)  # of the place of an axis, unit frame
_WORSE = 1.15  # times the rms, that an alignment may cost, or what nobody sees


@dataclass(frozen=True)
class Alignment:
    """A swept patch that follows another one exactly now."""

    kind: str  # parallel, coaxial
    leader: int
    index: int
    residual: float  # before: radians, or unit frame


@dataclass(frozen=True)
class _Line:
    """A direction that others may follow, and where it runs, if anywhere."""

    index: int
    direction: Array  # (3,), unit
    point: Array | None  # (3,)


def align_swept(fitted: Sequence[FittedPatch], points: Array) -> tuple[list[FittedPatch], list[Alignment]]:
    """The patches, the swept ones turned onto directions and axes that are within their uncertainty.

    points (n, 3) are those the patches index. Analytic patches lead, with the most points first; swept ones that
    follow none lead those after them.
    """
    patches, found = list(fitted), list[Alignment]()
    order = sorted(range(len(fitted)), key=lambda k: -len(fitted[k].patch.indices))
    lines = [line for k in order if (line := _line(k, fitted[k])) is not None]
    for k in order:
        patch = patches[k]
        if not isinstance(patch.primitive, Extrusion | Revolution):
            continue
        best = _followed(patch, lines, k, points[patch.patch.indices])
        if best is None:
            way = patch.primitive.direction if isinstance(patch.primitive, Extrusion) else patch.primitive.axis
            lines.append(_Line(k, way, patch.primitive.origin if isinstance(patch.primitive, Revolution) else None))
        else:
            patches[k], alignment = best
            found.append(alignment)
    return patches, found


def _line(index: int, patch: FittedPatch) -> _Line | None:
    """What an analytic patch offers to follow."""
    primitive = patch.primitive
    if isinstance(primitive, Plane):
        return _Line(index, primitive.normal_vector, None)
    if isinstance(primitive, Cylinder):
        return _Line(index, primitive.axis, primitive.point)
    if isinstance(primitive, Cone):
        return _Line(index, primitive.axis, primitive.apex)
    if isinstance(primitive, Torus):
        return _Line(index, primitive.axis, primitive.centre)
    return None


def _followed(
    patch: FittedPatch, lines: Sequence[_Line], index: int, points: Array
) -> tuple[FittedPatch, Alignment] | None:
    """The patch on the first axis, else the first direction, that it may follow; None where there is none."""
    primitive = patch.primitive
    assert isinstance(primitive, Extrusion | Revolution)
    own = primitive.direction if isinstance(primitive, Extrusion) else primitive.axis
    spread = 3 * np.sqrt(np.maximum(np.diag(patch.covariance), 0.0))
    widest = float(np.clip(spread[:2].max(), *_ANGLES))
    near = [line for line in lines if np.linalg.norm(np.cross(line.direction, own)) < widest]
    trials: list[tuple[Extrusion | Revolution, Alignment]] = []
    for line in near:
        way = unit(line.direction * np.sign(line.direction @ own))
        angle = float(np.linalg.norm(np.cross(way, own)))
        if isinstance(primitive, Extrusion):
            turned = replace(primitive, direction=way, x_axis=across(primitive.x_axis, way))
            trials.append((turned, Alignment("parallel", line.index, index, angle)))
            continue
        shift = np.zeros(3) if line.point is None else line.point - primitive.origin
        shift = shift - (shift @ way) * way
        gap = float(np.linalg.norm(shift))
        if line.point is not None and gap < np.clip(spread[2:].max(), *_SHIFTS):
            moved = replace(primitive, axis=way, origin=primitive.origin + shift)
            trials.insert(0, (moved, Alignment("coaxial", line.index, index, gap)))
        else:
            trials.append((replace(primitive, axis=way), Alignment("parallel", line.index, index, angle)))
    trials.sort(key=lambda trial: trial[1].kind != "coaxial")
    before = root_mean_square(primitive.distance(points))
    for surface, alignment in trials:
        rms = root_mean_square(surface.distance(points))
        if rms <= max(_WORSE * before, UNSEEN):
            return replace(patch, primitive=surface, rms=patch.rms * rms / max(before, 1e-300)), alignment
    return None
