"""Points as text: x y z [nx ny nz] in columns, whatever stands between them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sed2cad.errors import ScanError
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Array

COMMENT = re.compile(r"(#|//|%).*")
NORMAL_NAMES = ("nx", "ny", "nz")
UNIT_LENGTH = (0.9, 1.1)
"""Three columns after the coordinates are normals when most rows have about length 1, else colours."""


def read_text(path: Path) -> RawScan:
    """Columns x y z [nx ny nz], split by commas, semicolons, tabs or spaces; a header line may name them."""
    lines = [COMMENT.sub("", line).strip() for line in _decoded(path).splitlines()]
    lines = [_spaced(line) for line in lines if line]
    names: list[str] = []
    if lines and not _is_numeric(lines[0]):
        names = lines.pop(0).lower().replace('"', "").split()
    elif len(lines) > 1 and len(lines[0].split()) == 1:
        lines.pop(0)  # the number of points
    values = _table(lines, path.name)
    return RawScan(_pick(values, names, ("x", "y", "z"), 0), _normals(values, names), None, path.name)


def _decoded(path: Path) -> str:
    data = path.read_bytes()
    if b"\0" in data[:1000] and not data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ScanError(f"{path.name}: this is a binary file, not text; export the scan as text, PLY or STL")
    utf16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return data.decode("utf-16" if utf16 else "utf-8-sig", errors="replace")


def _spaced(line: str) -> str:
    """The line with single spaces between its columns; next to semicolons a comma is a decimal point."""
    if ";" in line:
        return line.replace(",", ".").replace(";", " ")
    return line.replace(",", " ")


def _is_numeric(line: str) -> bool:
    try:
        [float(word) for word in line.split()]
    except ValueError:
        return False
    return True


def _table(lines: list[str], name: str) -> Array:
    if not lines:
        raise ScanError(f"{name}: there are no points in this file; give one line 'x y z' per point")
    try:
        values = np.loadtxt(lines, dtype=np.float64, ndmin=2)
    except ValueError as error:
        width = len(lines[0].split())
        bad = next((line for line in lines if len(line.split()) != width or not _is_numeric(line)), lines[0])
        raise ScanError(
            f"{name}: cannot read {bad[:40]!r} as {width} numbers; give one line 'x y z' per point"
        ) from error
    if values.shape[1] < 3:
        raise ScanError(f"{name}: the lines have {values.shape[1]} numbers; give one line 'x y z' per point")
    return values


def _pick(values: Array, names: list[str], wanted: tuple[str, ...], first: int) -> Array:
    """The named columns where the header names all of them, else three columns from `first` on."""
    if len(names) == values.shape[1] and all(name in names for name in wanted):
        return values[:, [names.index(name) for name in wanted]]
    return np.ascontiguousarray(values[:, first : first + 3])


def _normals(values: Array, names: list[str]) -> Array | None:
    if values.shape[1] < 6:
        return None
    normals = _pick(values, names, NORMAL_NAMES, 3)
    length = np.linalg.norm(normals, axis=1)
    unit = (length > UNIT_LENGTH[0]) & (length < UNIT_LENGTH[1])
    return normals if unit.mean() > 0.5 else None
