"""The cheapest surface through a gap: a minimum cut among samples of the surfaces that may close it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.completion.gaps import Gap
from sed2cad.scan.scan import Array, Mesh, Scan
from sed2cad.topology.carve import sample_votes, triangulated
from sed2cad.topology.mincut import min_cut
from sed2cad.topology.samples import Samples, thinned

_MIXED = 10.0  # what keeps samples of different patches apart
_MOST_SAMPLES = 8000  # among which one cut chooses
_COARSER = 1.2
_BESIDE = 1.5  # cells: how far from a coarse cut the next one looks
_LONG = 4.0  # cells: a facet so long between samples of one surface is a chord, not on it
_ALONG = 0.5  # share of the cut around a sample that runs along its patch
_EXTENDED, _CAPPED, _NOWHERE = 0.1, 0.3, 1.0  # cost of area: of surfaces and caps beyond the scan, off all of them


def on_cheapest(scan: Scan, gap: Gap, faces: Samples, candidates: Samples, measured: int) -> Samples:
    """The candidates on the cheapest surface between inside and outside: first among few, then finer near these.

    faces: samples of what the scan shows; those at the rim of the gap do not say where inside is. Patches from number
    `measured` on are caps.
    """
    near = np.linalg.norm(faces.points - gap.centre, axis=1) < 2 * gap.radius
    off, _ = cKDTree(scan.points[gap.rim]).query(faces.points)
    faces = replace(faces, normals=np.where((off > gap.reach)[:, None, None], faces.normals, 0.0))
    cell = np.inf
    while True:
        cell, few = _coarsened(candidates, gap.spacing, cell / _COARSER**2)
        known = thinned(faces[near], cell) + thinned(faces[~near], max(cell, gap.radius / 2))
        on, band = _on_cut(known, few, cell, measured)
        if cell == gap.spacing:
            return candidates[_is_near(few[on], candidates, 0.5 * cell)]
        candidates = candidates[cKDTree(band).query(candidates.points, workers=-1)[0] < _BESIDE * cell]


def _coarsened(candidates: Samples, finest: float, coarsest: float) -> tuple[float, Samples]:
    """A cell between two sizes, and one candidate in each: few, that a cut is quick, as far as the coarsest allows."""
    cell, few = finest, candidates
    while len(few) > _MOST_SAMPLES and cell < coarsest:
        cell = min(_COARSER * cell, coarsest)
        few = thinned(candidates, cell)
    return (cell, few) if cell > _COARSER * finest else (finest, candidates)


def _is_near(some: Samples, samples: Samples, reach: float) -> NDArray[np.bool_]:
    """Which samples (n,) have one of the same patch within reach among some."""
    if len(some) == 0:
        return np.zeros(len(samples), dtype=bool)
    tree = cKDTree(np.hstack([some.points, _MIXED * some.labels[:, :1]]))
    distance, _ = tree.query(np.hstack([samples.points, _MIXED * samples.labels[:, :1]]))
    return np.asarray(distance < reach)


def _on_cut(faces: Samples, ghosts: Samples, spacing: float, measured: int) -> tuple[NDArray[np.bool_], Array]:
    """Which ghosts (n,) lie on the cheapest surface between inside and outside, of which the faces tell; and the
    corners (m, 3) of its facets that are not on what the scan shows."""
    samples = faces + ghosts
    tetrahedra = triangulated(samples.points, spacing)
    first, across = np.nonzero(tetrahedra.neighbours > np.arange(len(tetrahedra.corners))[:, None])
    second = tetrahedra.neighbours[first, across]
    facets = tetrahedra.facets(first, across)
    _, area = Mesh(tetrahedra.points, facets).face_normals()
    shared = _shared(facets, samples.labels, len(tetrahedra.points))
    shared[tetrahedra.longest_edges(facets) > _LONG * spacing] = -1
    price = np.where(shared < 0, _NOWHERE, np.where(shared < measured, _EXTENDED, _CAPPED)) * area / spacing**2
    vote = sample_votes(tetrahedra, samples)
    inside = ~min_cut(np.maximum(vote, 0), np.maximum(-vote, 0), np.column_stack([first, second]), price, price)
    cut = inside[first] != inside[second]
    along = area[cut] * (shared[cut] >= 0)
    whole, own = (np.bincount(facets[cut].ravel(), np.repeat(a, 3), len(tetrahedra.points)) for a in (area[cut], along))
    new = facets[cut][(shared[cut] < 0) | (facets[cut] >= len(faces)).any(axis=1)]
    return ((own > _ALONG * whole) & (whole > 0))[len(faces) : len(samples)], tetrahedra.points[new.ravel()]


def _shared(facets: NDArray[np.int64], labels: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The patch (m,) that all corners of a facet (m, 3) of `count` points lie on, -1 for none; labels (n, 2)."""
    far = -np.arange(2, 2 + count - len(labels))
    a, b, c = np.moveaxis(np.vstack([labels, np.column_stack([far, far])])[facets], 1, 0)
    shared = np.full(len(facets), -1)
    for own in a.T:
        on = (own[:, None] == b).any(axis=1) & (own[:, None] == c).any(axis=1)
        shared = np.where(on, np.maximum(shared, own), shared)
    return shared
