"""Whole parts from faces that are known exactly, measured with noise and fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sed2cad.fitting import fit_patches
from sed2cad.primitives.base import Array, FittedPatch, Patch
from sed2cad.primitives.vectors import tangent_frame
from sed2cad.scan.scan import Frame, Scan
from sed2cad.topology.model import Topology
from tests.primitives.patches import Sample, cylinder_patch, plane_patch, rotated

UNTRACED = Topology((), (), np.zeros((0, 3)), 0.0)


def face(rng: np.random.Generator, normal: Sequence[float], centre: Sequence[float], size: float = 0.4) -> Sample:
    """A square of a plane; 300 points."""
    return placed(plane_patch(rng, 300, size, size), normal, centre)


def hole(
    rng: np.random.Generator, centre: Sequence[float], radius: float, axis: Sequence[float] = (0, 0, 1)
) -> Sample:
    """A bore of height 0.1; 150 points."""
    return placed(cylinder_patch(rng, 150, radius, 0.1), axis, centre)


def placed(sample: Sample, axis: Sequence[float], centre: Sequence[float]) -> Sample:
    """A sample made about z, its z turned to the axis and moved to the centre."""
    z = np.array(axis, float) / np.linalg.norm(axis)
    turn, shift = np.column_stack([*tangent_frame(z), z]), np.array(centre, float)
    return Sample(
        rotated(sample.truth, turn, shift), sample.points @ turn.T + shift, sample.normals @ turn.T
    )


def fitted_part(
    faces: Sequence[Sample], noise: float, rng: np.random.Generator, turn: Array | None = None
) -> tuple[list[FittedPatch], Scan]:
    """Fits to all faces, measured with Gaussian noise and turned (3, 3) as one, and the scan."""
    turn = np.eye(3) if turn is None else turn
    points = [f.points + noise * f.normals * rng.normal(size=(len(f.points), 1)) for f in faces]
    ends = np.cumsum([len(part) for part in points])
    patches = [
        Patch(np.arange(end - len(part), end), f.truth.kind, np.ones(len(part), bool))
        for f, part, end in zip(faces, points, ends)
    ]
    together, normals = np.vstack(points) @ turn.T, np.vstack([f.normals for f in faces]) @ turn.T
    scan = Scan(together, normals, None, Frame(np.zeros(3), 1.0), noise, 0.01)
    return fit_patches(scan, patches), scan
