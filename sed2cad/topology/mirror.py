"""Thin walls and narrow slots: the samples of one side, copied to the other.

Where two faces are nearer to each other than their samples are, a Delaunay triangulation joins them across.
When both carry the same pattern of samples, each triangle's smallest sphere is empty whatever the thickness,
and both faces appear in the triangulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.primitives.base import FittedPatch
from sed2cad.scan.scan import Array
from sed2cad.topology.edges import Meetings, joined
from sed2cad.topology.samples import Labels, Mask, Samples, on_surfaces

_REACH = 4.5  # spacings: walls thicker than this need no help
_NEIGHBOURS = 32
_CLOSE = 0.35  # spacings: two samples of one face or edge nearer than this are one


@dataclass(frozen=True)
class Facing:
    """Samples that look at another face, or away from its back, across a short distance."""

    sample: Labels  # (m,)
    side: Labels  # (m,) which of the sample's two labels
    label: Labels  # (m,) the other face
    other: Labels  # (m,) a sample there


def mirrored(samples: Samples, fitted: Sequence[FittedPatch], spacing: float) -> Samples:
    """The samples (n) and, for those near an opposite face or edge, their feet on it."""
    edges = samples[samples.on_edge]
    if len(edges):
        edges = _edges_both_ways(edges, fitted, spacing)
    samples = samples[~samples.on_edge] + edges
    facing = facing_pairs(samples, _REACH * spacing)
    own = samples.labels[facing.sample, facing.side]
    over = _feet(samples, facing, own < facing.label, fitted, spacing)
    back = _feet(samples, facing, own > facing.label, fitted, spacing)
    kept = _not_near(samples, over, spacing)
    back = back[_not_near(back, samples[kept] + over, spacing)]
    return samples[kept] + over + back


def facing_pairs(samples: Samples, reach: float) -> Facing:
    """For every side of every sample the nearest sample of an opposed face within reach, if any."""
    distance, found = cKDTree(samples.points).query(samples.points, k=_NEIGHBOURS, distance_upper_bound=reach)
    found = np.minimum(found, len(samples) - 1)
    parts = []
    for mine in (0, 1):
        best = np.full(len(samples), np.inf)
        label, other = np.full(len(samples), -1, dtype=np.int64), np.zeros(len(samples), dtype=np.int64)
        for theirs in (0, 1):
            opposed = np.einsum("ikj,ij->ik", samples.normals[found, theirs], samples.normals[:, mine]) < -0.8
            named = samples.labels[found, theirs]
            fits = opposed & (named >= 0) & (named != samples.labels[:, mine, None]) & np.isfinite(distance)
            first = fits.argmax(axis=1)
            row = np.arange(len(samples))
            nearer = fits[row, first] & (distance[row, first] < best)
            best = np.where(nearer, distance[row, first], best)
            label = np.where(nearer, named[row, first], label)
            other = np.where(nearer, found[row, first], other)
        use = (label >= 0) & (samples.labels[:, mine] >= 0) & (samples.on_edge if mine else True)
        at = np.flatnonzero(use)
        parts.append(Facing(at, np.full(len(at), mine), label[at], other[at]))
    a, b = parts
    names = ("sample", "side", "label", "other")
    return Facing(*(np.concatenate([getattr(a, name), getattr(b, name)]) for name in names))


def _feet(
    samples: Samples, facing: Facing, use: Mask, fitted: Sequence[FittedPatch], spacing: float
) -> Samples:
    """The feet of the samples in `use` on the faces they face, where those faces reach that far."""
    sample, side, label = facing.sample[use], facing.side[use], facing.label[use]
    start, normal = samples.points[sample], samples.normals[sample, side]
    feet, normals = on_surfaces(start, label, fitted)
    way = feet - start
    depth = np.abs(np.einsum("ij,ij->i", way, normal))
    good = (depth > 0.9 * np.linalg.norm(way, axis=1)) & (depth < _REACH * spacing)
    good &= _reaches(samples, feet, label, spacing)
    return Samples.within_faces(feet[good], label[good], normals[good])


def _reaches(samples: Samples, feet: Array, labels: Labels, spacing: float) -> Mask:
    """Whether the faces `labels` (m,) go on to `feet` (m, 3): not beyond an edge, not on top of one."""
    good = np.zeros(len(feet), dtype=bool)
    for label in np.unique(labels):
        at = labels == label
        face = samples[(samples.labels == label).any(axis=1)]
        distance, nearest = cKDTree(face.points).query(feet[at])
        near = face[nearest]
        other = np.where((near.labels[:, 0] == label)[:, None], near.normals[:, 1], near.normals[:, 0])
        ahead = np.einsum("ij,ij->i", feet[at] - near.points, other)
        inside = np.where(near.convex, -ahead, ahead) > _CLOSE * spacing
        good[at] = (distance < 3 * spacing) & (~near.on_edge | inside)
    return good


def _not_near(samples: Samples, fresh: Samples, spacing: float) -> Mask:
    """Which samples are on an edge or have no fresh sample of their face close to them."""
    if len(fresh) == 0 or len(samples) == 0:
        return np.ones(len(samples), dtype=bool)
    distance, nearest = cKDTree(fresh.points).query(samples.points)
    same = (samples.labels[:, 0] == fresh.labels[nearest, 0]) & ~samples.on_edge
    return ~(same & (distance < _CLOSE * spacing))


def _edges_both_ways(edges: Samples, fitted: Sequence[FittedPatch], spacing: float) -> Samples:
    """Edge samples and, where another edge runs along close by, their feet on that edge."""
    facing = facing_pairs(edges, _REACH * spacing)
    mine, theirs = edges.labels[facing.sample], edges.labels[facing.other]
    order = np.sign(mine[:, 0] - theirs[:, 0]) * 2 + np.sign(mine[:, 1] - theirs[:, 1])
    over = _edge_feet(edges, facing, order < 0, fitted, spacing)
    back = _edge_feet(edges, facing, order > 0, fitted, spacing)
    if len(over) == 0:
        return edges + back
    distance, nearest = cKDTree(over.points).query(edges.points)
    replaced = (edges.labels == over.labels[nearest]).all(axis=1) & (distance < _CLOSE * spacing)
    return edges[~replaced] + over + back


def _edge_feet(
    edges: Samples, facing: Facing, use: Mask, fitted: Sequence[FittedPatch], spacing: float
) -> Samples:
    """The edge samples in `use` moved onto the two primitives of the edge they face."""
    sample, other = facing.sample[use], facing.other[use]
    start, sides = edges.points[sample], edges.labels[other]
    size = np.full(len(start), _REACH * spacing)
    feet, kept = joined(Meetings(start, sides, size, edges.convex[other]), fitted, spacing)
    near = np.linalg.norm(feet.points - edges.points[other[kept]], axis=1) < 1.5 * spacing
    return feet[near]
