"""Points with normals on a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.mesh import FLAT, border_lengths, is_measured, smooth_edges, smooth_fans, smooth_parts
from sed2cad.scan.scan import Array, Mesh

COUNT = 30_000
"""Points on a mesh."""
LEAST = 12
"""Points on the smallest part of a mesh between sharp edges."""
EACH = 4.0
"""Points on each triangle of a round surface."""
SMOOTH = 30.0
"""Edges that turn less than this many degrees are not sharp: normals are averaged across them."""


@dataclass(frozen=True)
class Sample:
    """Points on a mesh."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3), unit
    triangle: NDArray[np.int64]  # (n,) that each lies on
    part: NDArray[np.int64] | None  # (n,) part between sharp edges; None of a measured mesh


def sample_mesh(mesh: Mesh, seed: int, count: int = COUNT) -> Sample:
    """About `count` points, spread by area.

    Of a measured mesh there are no parts: its sharp edges are noise. Else the parts get at least a dozen points each,
    and as many as their border has spacings, so that points of a narrow strip are no farther apart than others; and
    every triangle of a round surface gets some, because small fillets are made of many small ones. All this at most
    `count` more. Normals are interpolated between those of the corners, so that a tessellated cylinder has round ones;
    the points lie on the round surface, too.
    """
    rng = np.random.default_rng(seed)
    smooth = smooth_edges(mesh, SMOOTH)
    parts, part = smooth_parts(mesh, smooth)
    measured = is_measured(mesh)
    area = mesh.face_normals()[1]
    expected = count * area / area.sum() if measured else _expected(mesh, smooth, parts, part, count)
    ends = np.floor(np.cumsum(expected) + rng.random()).astype(np.int64)
    face = np.repeat(np.arange(len(mesh.faces)), np.diff(ends, prepend=0))
    weight = rng.random((len(face), 2))
    weight = np.where((weight.sum(axis=1) > 1)[:, None], 1 - weight, weight)
    weight = np.column_stack([1 - weight.sum(axis=1), weight])
    corners, corner_normals = mesh.vertices[mesh.faces[face]], _corner_normals(mesh, smooth_fans(mesh, smooth))[face]
    points = bulged(corners, corner_normals, weight)
    normals = np.einsum("nk,nki->ni", weight, corner_normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return Sample(points, normals, face, None if measured else part[face])


def _expected(
    mesh: Mesh, smooth: NDArray[np.int64], parts: int, part: NDArray[np.int64], count: int
) -> Array:
    """How many points each triangle (f,) gets."""
    normals, area = mesh.face_normals()
    part_area = np.bincount(part, area, parts)
    by_area = count * part_area / area.sum()
    spacing = np.sqrt(area.sum() / count)
    of_part = np.maximum(by_area, np.maximum(LEAST, border_lengths(mesh, parts, part) / spacing))
    share = area / np.maximum(part_area, 1e-300)[part]
    plain = by_area[part] * share
    pairs = smooth // 3
    bent = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < np.cos(FLAT)]
    wanted = of_part[part] * share
    wanted[bent] = np.maximum(wanted[bent], EACH)
    more = wanted - plain
    return np.asarray(plain + more * min(1.0, count / max(more.sum(), 1.0)))


def bulged(corners: Array, normals: Array, weight: Array) -> Array:
    """Points (n, 3) at barycentric coordinates (n, 3) of the curved triangles over corners (n, 3, 3) with normals.

    Phong tessellation (Boubekeur and Alexa 2008): half-way to the mean of the projections onto the corners' tangent
    planes. On a circle that is exact to second order: what a tessellation cuts off is put back.
    """
    flat = np.einsum("nk,nki->ni", weight, corners)
    height = np.einsum("nki,nki->nk", corners - flat[:, None], normals)
    return np.asarray(flat + 0.5 * np.einsum("nk,nk,nki->ni", weight, height, normals))


def _corner_normals(mesh: Mesh, fans: NDArray) -> Array:
    """Unit normals (f, 3, 3) at the corners: means over the triangles of the same fan (f, 3).

    Weighted by the square of the area (a plane beside a fillet keeps its normal, at which the fillet begins) and by the
    angle at the corner (then it does not matter how quadrangles are cut).
    """
    normals, area = mesh.face_normals()
    number = fans.ravel()
    weighted = (normals[:, None] * (area[:, None] ** 2 * _angles(mesh))[:, :, None]).reshape(-1, 3)
    total: Array = np.column_stack([np.bincount(number, weighted[:, a]) for a in range(3)])
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    return total[number].reshape(-1, 3, 3)


def _angles(mesh: Mesh) -> Array:
    """Angles (f, 3) at the corners of the triangles, in radians."""
    corners = mesh.vertices[mesh.faces]
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=2), (ahead * back).sum(axis=2))
