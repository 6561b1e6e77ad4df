"""A sheet of the surface that a scan shows: a thin closed body whose front is that surface and whose back is not.

Where a scan shows one side of a part only, no closed surface lies near its points. Copies of the samples a little
below, which look the other way, make one, and its front ends where the scan does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.errors import AssemblyError
from sed2cad.primitives.base import UNLABELLED, FittedPatch
from sed2cad.scan.scan import Mesh, Scan
from sed2cad.topology.carve import carved
from sed2cad.topology.edges import surface_samples
from sed2cad.topology.manifold import nearest_triangles
from sed2cad.topology.mincut import Labels
from sed2cad.topology.proxy import MOST_SAMPLES, divided, encloses, few_enough
from sed2cad.topology.samples import Samples

_DEPTH = 3.0  # spacings
_WIDE = 4.0  # depths: wider holes are none that chance leaves between random points
_LONGEST = 2.0  # spacings: of an edge, so that a border is not smoothed over more
_NEAR = 0.7  # depths: copies nearer to the front, beside an edge, are not needed


@dataclass(frozen=True)
class Sheet:
    """A closed surface."""

    mesh: Mesh
    back: Labels  # triangles that the scan does not show


def sheet_of(scan: Scan, fitted: Sequence[FittedPatch]) -> Sheet:
    """The sheet of the surface that the scan shows. AssemblyError where there is none."""
    front, spacing = few_enough(surface_samples(scan, fitted), scan.spacing, MOST_SAMPLES // 2)
    within = front[~front.on_edge]
    below = within.points - _DEPTH * spacing * within.normals[:, 0]
    off, _ = cKDTree(front.points).query(below)
    far = off > _NEAR * _DEPTH * spacing
    back = Samples.within_faces(below[far], np.full(far.sum(), UNLABELLED), -within.normals[far, 0])
    whole = carved(front + back, spacing, _WIDE * _DEPTH * spacing)
    if not encloses(whole):
        raise AssemblyError("no sheet could be laid through the points of the scan")
    of_back = cKDTree(np.vstack([front.points, back.points])).query(whole.vertices)[1] >= len(front)
    mesh = divided(whole, _LONGEST * spacing)
    _, parent = nearest_triangles(whole, mesh.centroids())
    return Sheet(mesh, np.flatnonzero(of_back[whole.faces[parent]].any(axis=1)))
