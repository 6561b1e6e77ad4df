"""STL files, binary and ascii. The triangles do not share corners yet: see mesh.weld."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sed2cad.errors import ScanError
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Array, Mesh

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(path: Path) -> RawScan:
    """The triangles of an STL file."""
    data = path.read_bytes()
    ascii_file = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:2000].lower()
    corners = _ascii(data, path.name) if ascii_file else _binary(data, path.name)
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    return RawScan(corners, None, Mesh(corners, faces), path.name)


def _binary(data: bytes, name: str) -> Array:
    """Corners (3 f, 3) after a header of 80 bytes and a count."""
    if len(data) < 84:
        raise ScanError(f"{name}: this is not an STL file (only {len(data)} bytes); export the mesh again")
    count = int(np.frombuffer(data, "<u4", 1, 80)[0])
    missing = 84 + count * RECORD.itemsize - len(data)
    if missing > 0 and all(32 <= byte < 127 or byte in b"\r\n\t" for byte in data[:84]):
        raise ScanError(f"{name}: this is text, not an STL file; export the mesh again as STL")
    if missing > 0:
        raise ScanError(
            f"{name}: the file is cut short, {missing} bytes of its {count} triangles are missing; "
            "copy or export it again"
        )
    if count == 0:
        raise ScanError(f"{name}: there are no triangles in this STL file; export the mesh again")
    return np.frombuffer(data, RECORD, count, 84)["corners"].reshape(-1, 3).astype(np.float64)


def _ascii(data: bytes, name: str) -> Array:
    try:
        corners = np.array(VERTEX.findall(data), dtype=np.float64)
    except ValueError as error:
        raise ScanError(f"{name}: a vertex holds a word, not a number; export the mesh again") from error
    if not len(corners) or len(corners) % 3 or b"endsolid" not in data[-2000:].lower():
        triangles = len(corners) // 3
        raise ScanError(f"{name}: the file is cut short after {triangles} triangles; copy or export it again")
    return corners
