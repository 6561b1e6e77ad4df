"""From what a file holds to the scan that all stages see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.clean import clean_mesh, clean_points, require_depth
from sed2cad.scan.mesh import weld, wound_outwards
from sed2cad.scan.neighbours import nearest, search_tree, spatial_order
from sed2cad.scan.noise import noise_level
from sed2cad.scan.normals import REACH, Tangents, tangents
from sed2cad.scan.orient import STRONG, outward_signs
from sed2cad.scan.outliers import COUNT, inliers
from sed2cad.scan.outside import outward_votes
from sed2cad.scan.raw import RawScan
from sed2cad.scan.sample import sample_mesh
from sed2cad.scan.scan import Array, Frame, Mesh, Scan

EVIDENCE = 0.3
"""Share of strong votes from which on they may contradict the normals that came with the scan."""
DIVIDED = 0.1
"""Votes for and against given normals that are so near to half each do not tell which way all of them point."""
RANDOM = 0.1
"""Share of opposed neighbours from which on given normals do not agree among themselves."""


def prepare(raw: RawScan, seed: int) -> Scan:
    """The scan in the unit frame: distinct points without outliers, outward normals, noise and spacing.

    A mesh is welded, wound outwards and sampled (deterministic by seed). Points come in spatial order, which
    does not depend on their order in the file. ScanError when there is nothing to reconstruct.
    """
    if raw.mesh is not None and len(raw.mesh.faces):
        return _from_mesh(raw, raw.mesh, seed)
    points, given = clean_points(raw)
    order = spatial_order(points)
    points, given = points[order], None if given is None else given[order]
    distance, near = nearest(points, COUNT)
    keep = inliers(distance, near)
    frame = _frame(points[keep])
    points, distance = frame.to_unit(points[keep]), distance[keep] / frame.scale
    if given is None or not _usable(given[keep]).any():
        normals = _estimated(points, distance[:, 5])
    else:
        normals = _outward(points, _unit(points, given[keep]), distance[:, 5])
    noise = noise_level(points, normals)
    if given is None:
        require_depth(points, raw.name, noise)
    return Scan(points, normals, None, frame, noise, float(np.median(distance[:, 0])))


def _from_mesh(raw: RawScan, mesh: Mesh, seed: int) -> Scan:
    mesh = wound_outwards(weld(clean_mesh(raw, mesh)))
    frame = _frame(mesh.vertices)
    mesh = Mesh(frame.to_unit(mesh.vertices), mesh.faces)
    sample = sample_mesh(mesh, seed)
    order = spatial_order(sample.points)
    points, normals = sample.points[order], sample.normals[order]
    distance, _ = nearest(points, 6)
    outward = _outward(points, normals, distance[:, 5], whole=True)
    if (outward * normals).sum() < 0:
        mesh = replace(mesh, faces=mesh.faces[:, ::-1])
    noise = noise_level(points, outward)
    scan = Scan(points, outward, mesh, frame, noise, float(np.median(distance[:, 0])))
    if sample.part is None:
        return scan
    return replace(scan, part=sample.part[order], triangle=sample.triangle[order])


def _frame(points: Array) -> Frame:
    low, high = points.min(axis=0), points.max(axis=0)
    return Frame((low + high) / 2, float(np.linalg.norm(high - low)))


def _estimated(points: Array, sixth: Array) -> Array:
    """Outward normals (n, 3) from the points (n, 3) alone; sixth: distances (n,) to the sixth neighbour."""
    planes = tangents(points)
    votes = outward_votes(points, planes.normals, sixth)
    return planes.normals * outward_signs(planes, votes)[:, None]


def _outward(points: Array, normals: Array, sixth: Array, whole: bool = False) -> Array:
    """The given unit normals (n, 3), all turned round where most of them point inwards.

    Each for itself only (unless `whole`) where they do not agree among themselves, or where the votes of the outside
    are divided: in hollow parts every third vote may be wrong, and normals that agree are worth more.
    """
    votes = outward_votes(points, normals, sixth)
    strong = np.abs(votes) > STRONG
    if strong.mean() < EVIDENCE:
        return normals
    against = float((votes[strong] < 0).mean())
    if whole or (abs(against - 0.5) > DIVIDED and _disagreement(points, normals) < RANDOM):
        return -normals if against > 0.5 else normals
    _, near = search_tree(points).query(points, min(REACH, len(points)), workers=-1)
    return normals * outward_signs(Tangents(normals, points, near), votes)[:, None]


def _disagreement(points: Array, normals: Array) -> float:
    """Share of opposed ones among the near neighbours that lie beside each other, not across a wall."""
    index = nearest(points, COUNT)[1]
    way = points[index] - points[:, None]
    cosine = np.einsum("nki,ni->nk", normals[index], normals)
    off = np.abs(np.einsum("nki,ni->nk", way, normals))
    beside = (off < 0.25 * np.linalg.norm(way, axis=2)) & (np.abs(cosine) > 0.8)
    return float((cosine[beside] < 0).mean()) if beside.any() else 0.0


def _usable(normals: Array) -> NDArray[np.bool_]:
    return np.isfinite(normals).all(axis=1) & (np.abs(normals).max(axis=1) > 0)


def _unit(points: Array, normals: Array) -> Array:
    """Unit normals (n, 3); a point without a usable one gets that of the nearest point that has one."""
    usable = _usable(normals)
    if not usable.all():
        _, index = search_tree(points[usable]).query(points)
        normals = normals[usable][index]
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
