"""Wavefront OBJ files: vertices and faces; materials, textures and groups are skipped."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sed2cad.errors import ScanError
from sed2cad.scan.polygons import polygon_mesh
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Array


def read_obj(path: Path) -> RawScan:
    """Vertices (with vn as their normals when there is one each and no face) and polygons."""
    rows: dict[bytes, list[list[bytes]]] = {b"v": [], b"vn": []}
    corners: list[int] = []
    lengths: list[int] = []
    for line in path.read_bytes().replace(b"\\\n", b" ").splitlines():
        key, *words = line.split() or [b""]
        if key in rows:
            rows[key].append(words[:3])
        elif key == b"f":
            corners += _polygon(words, len(rows[b"v"]), path.name)
            lengths.append(len(words))
    points, normals = _numbers(rows[b"v"], path.name), _numbers(rows[b"vn"], path.name)
    if not len(points):
        raise ScanError(f"{path.name}: there are no vertices in this OBJ file; export the mesh again")
    if lengths:
        mesh = polygon_mesh(points, np.array(lengths), np.array(corners), path.name)
        return RawScan(points, None, mesh, path.name)
    return RawScan(points, normals if len(normals) == len(points) else None, None, path.name)


def _polygon(words: list[bytes], count: int, name: str) -> list[int]:
    """Indices from 0 of corners written as v, v/vt, v//vn or v/vt/vn, negative ones counted from the end."""
    try:
        indices = [int(word.split(b"/", 1)[0]) for word in words]
    except ValueError as error:
        face = b" ".join(words)[:40].decode("latin-1")
        raise ScanError(f"{name}: cannot read the face {face!r}; export the mesh again") from error
    return [i - 1 if i > 0 else count + i for i in indices]


def _numbers(rows: list[list[bytes]], name: str) -> Array:
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise ScanError(f"{name}: a vertex is not three numbers; export the mesh again") from error
