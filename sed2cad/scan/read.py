"""Reading scans: one reader per extension."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sed2cad.errors import ScanError
from sed2cad.scan.arrays import read_npy, read_npz
from sed2cad.scan.obj import read_obj
from sed2cad.scan.ply import read_ply
from sed2cad.scan.raw import RawScan
from sed2cad.scan.stl import read_stl
from sed2cad.scan.text import read_text

READERS: dict[str, Callable[[Path], RawScan]] = {
    ".ply": read_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".xyz": read_text,
    ".txt": read_text,
    ".csv": read_text,
    ".asc": read_text,
    ".pts": read_text,
    ".npy": read_npy,
    ".npz": read_npz,
}


def read_scan(path: str | Path) -> RawScan:
    """The points, normals and mesh in a file, in its own coordinates; ScanError where it cannot be read."""
    path = Path(path)
    reader = reader_of(path)
    try:
        return reader(path)
    except OSError as error:
        raise ScanError(f"{path.name}: cannot be read ({error.strerror or error}); check the file") from error


def reader_of(path: Path) -> Callable[[Path], RawScan]:
    """The reader for a file; ScanError where there is none, or no such file, or nothing in it."""
    if path.is_dir():
        raise ScanError(f"{path}: this is a folder; give one scan file")
    if not path.exists():
        raise ScanError(f"{path}: there is no such file; check the name")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ScanError(f"{path.name}: unknown file type {path.suffix!r}; sed2cad reads {' '.join(READERS)}")
    if path.stat().st_size == 0:
        raise ScanError(f"{path.name}: the file is empty; export or copy the scan again")
    return reader
