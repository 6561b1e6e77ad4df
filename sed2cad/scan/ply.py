"""PLY files: ascii and binary, any elements and properties in any order, points or mesh.

Format: Greg Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sed2cad.errors import ScanError
from sed2cad.scan.polygons import polygon_mesh
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Array

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}
ENCODINGS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class Property:
    """One column of an element; a list property has the type of its length too."""

    name: str
    kind: str  # numpy type without byte order
    count: str = ""  # type of the length of a list, "" for a single number

    @property
    def length(self) -> str:
        """Name of the field that holds a list's length."""
        return f"{self.name} length"

    def as_double(self) -> Property:
        """The same with all numbers f8."""
        return Property(self.name, "f8", "f8" if self.count else "")


@dataclass(frozen=True)
class Element:
    """One table of the file."""

    name: str
    rows: int
    properties: tuple[Property, ...]


@dataclass(frozen=True)
class Table:
    """The rows of an element that were asked for."""

    columns: dict[str, NDArray]  # single numbers, (rows,)
    lists: dict[str, tuple[NDArray, NDArray]]  # lists: lengths (rows,) and all values in one array


def read_ply(path: Path) -> RawScan:
    """Points, normals and mesh of a PLY file."""
    data = path.read_bytes()
    encoding, elements, start = _header(data, path.name)
    tables: dict[str, Table] = {}
    body = _Body(data[start:], encoding, path.name)
    for element in elements:
        tables[element.name] = body.table(element)
        if "vertex" in tables and ("face" in tables or all(e.name != "face" for e in elements)):
            break
    if "vertex" not in tables:
        raise ScanError(f"{path.name}: this PLY file has no vertices; export the points or the mesh again")
    return _scan(tables, path.name)


def _scan(tables: dict[str, Table], name: str) -> RawScan:
    columns = tables["vertex"].columns
    points = _columns(columns, ("x", "y", "z"))
    if points is None:
        raise ScanError(f"{name}: the vertices have no x, y and z; export the points or the mesh again")
    normals = _columns(columns, ("nx", "ny", "nz"))
    faces = tables["face"].lists if "face" in tables else {}
    polygons = faces.get("vertex_indices", faces.get("vertex_index"))
    mesh = polygon_mesh(points, *polygons, name) if polygons is not None and len(polygons[0]) else None
    return RawScan(points, normals, mesh, name)


def _columns(columns: dict[str, NDArray], names: tuple[str, ...]) -> Array | None:
    if any(name not in columns for name in names):
        return None
    return np.column_stack([columns[name] for name in names]).astype(np.float64)


def _header(data: bytes, name: str) -> tuple[str, list[Element], int]:
    """Encoding, elements and where the body starts."""
    if data[:3] != b"ply":
        raise ScanError(f"{name}: this is not a PLY file (it does not begin with 'ply'); export it again")
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    if end < 0 or start == 0:
        raise ScanError(f"{name}: the file is cut short within its PLY header; copy or export it again")
    encoding, elements = "", []
    for line in data[:end].decode("latin-1").replace("\r", "\n").split("\n"):
        try:
            match line.split():
                case ["format", encoding, *_]:
                    pass
                case ["element", title, rows]:
                    elements.append(Element(title.lower(), int(rows), ()))
                case ["property", *words]:
                    last = elements[-1]
                    elements[-1] = Element(last.name, last.rows, (*last.properties, _property(words)))
        except (ValueError, KeyError, IndexError) as error:
            raise ScanError(f"{name}: cannot read the header line {line!r}; export the scan again") from error
    if encoding not in ENCODINGS:
        raise ScanError(f"{name}: unknown PLY format {encoding!r}; export as ascii or binary_little_endian")
    return encoding, elements, start


def _property(words: list[str]) -> Property:
    if words[0] == "list":
        _, count, kind, title = words
        return Property(title.lower(), TYPES[kind], TYPES[count])
    kind, title = words
    return Property(title.lower(), TYPES[kind])


class _Body:
    """The tables of a body, element after element; an ascii body is turned into one in which all numbers are
    f8.
    """

    def __init__(self, data: bytes, encoding: str, name: str) -> None:
        self.ascii, self.order, self.at, self.name = encoding == "ascii", ENCODINGS[encoding], 0, name
        self.data = self._parsed(data) if self.ascii else data

    def _parsed(self, text: bytes) -> bytes:
        try:
            return np.array(text.split() or [], dtype=np.float64).tobytes()
        except ValueError as error:
            raise ScanError(f"{self.name}: a row holds a word, not a number; export it again") from error

    def table(self, element: Element) -> Table:
        """All rows at once when they have one layout (lists of the same length), row by row otherwise."""
        if self.ascii:
            element = Element(element.name, element.rows, tuple(p.as_double() for p in element.properties))
        if not element.rows:
            return Table({p.name: np.empty(0) for p in element.properties if not p.count}, {})
        layout = self._layout(element)
        lists = [p for p in element.properties if p.count]
        missing = self.at + element.rows * layout.itemsize - len(self.data)
        if missing <= 0:
            rows = np.frombuffer(self.data, layout, element.rows, self.at)
            if all((rows[p.length] == rows[p.length][0]).all() for p in lists):
                self.at += rows.nbytes
                return _table(rows, element)
        elif not lists:
            raise self._cut_short(missing, element)
        return self._rows(element)

    def _layout(self, element: Element) -> np.dtype:
        """The record of the row that starts here, lists with the lengths they have in it."""
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        at, length = self.at, 0
        for p in element.properties:
            if p.count:
                length = int(self._numbers(p.count, 1, at, element)[0])
                fields.append((p.length, self.order + p.count, ()))
                at += np.dtype(p.count).itemsize
            fields.append((p.name, self.order + p.kind, (length,) if p.count else ()))
            at += np.dtype(p.kind).itemsize * (length if p.count else 1)
        return np.dtype(fields)

    def _rows(self, element: Element) -> Table:
        cells: dict[Property, list[NDArray]] = {p: [] for p in element.properties}
        for _ in range(element.rows):
            for p in element.properties:
                length = int(self._next(p.count, 1, element)[0]) if p.count else 1
                cells[p].append(self._next(p.kind, length, element))
        columns = {p.name: np.concatenate(rows) for p, rows in cells.items() if not p.count}
        lists = {p.name: _flat(rows) for p, rows in cells.items() if p.count}
        return Table(columns, lists)

    def _next(self, kind: str, count: int, element: Element) -> NDArray:
        values = self._numbers(kind, count, self.at, element)
        self.at += values.nbytes
        return values

    def _numbers(self, kind: str, count: int, at: int, element: Element) -> NDArray:
        missing = at + count * np.dtype(kind).itemsize - len(self.data)
        if missing > 0 or count < 0:
            raise self._cut_short(max(missing, 1), element)
        return np.frombuffer(self.data, self.order + kind, count, at)

    def _cut_short(self, missing: int, element: Element) -> ScanError:
        amount = f"{missing // 8} numbers" if self.ascii else f"{missing} bytes"
        least = "at least " if any(p.count for p in element.properties) else ""
        return ScanError(
            f"{self.name}: the file is cut short, {least}{amount} of its {element.rows} {element.name} rows "
            "are missing; copy or export it again"
        )


def _table(rows: NDArray, element: Element) -> Table:
    columns = {p.name: rows[p.name] for p in element.properties if not p.count}
    lists = {p.name: (rows[p.length], rows[p.name].ravel()) for p in element.properties if p.count}
    return Table(columns, lists)



def _flat(rows: list[NDArray]) -> tuple[NDArray, NDArray]:
    return np.array([len(row) for row in rows]), np.concatenate(rows)
