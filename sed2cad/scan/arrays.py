"""NumPy files: .npy with (n, 3) or (n, 6), .npz with points and normals."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sed2cad.errors import ScanError
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Array


def read_npy(path: Path) -> RawScan:
    """An array (n, 3) of points or (n, 6) of points and normals."""
    try:
        with path.open("rb") as file:
            array = np.lib.format.read_array(file, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise _damaged(path) from error
    return _scan(array, None, path.name)


def read_npz(path: Path) -> RawScan:
    """Arrays `points` and perhaps `normals`; a single array of any name is taken as points."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, OSError, zipfile.BadZipFile, AttributeError) as error:
        raise _damaged(path) from error
    points = next(iter(arrays.values())) if len(arrays) == 1 else arrays.get("points")
    if points is None:
        there = ", ".join(arrays) or "none"
        raise ScanError(f"{path.name}: there is no array 'points' (arrays: {there}); save it under that name")
    return _scan(points, arrays.get("normals"), path.name)


def _scan(points: NDArray, normals: NDArray | None, name: str) -> RawScan:
    if normals is None and points.ndim == 2 and points.shape[1] == 6:
        points, normals = points[:, :3], points[:, 3:]
    points = _table(points, "points", name)
    if normals is not None:
        normals = _table(normals, "normals", name)
        if len(normals) != len(points):
            raise ScanError(f"{name}: {len(normals)} normals for {len(points)} points; give one each")
    return RawScan(points, normals, None, name)


def _table(array: NDArray, what: str, name: str) -> Array:
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise ScanError(
            f"{name}: {what} is an array {array.shape} of {array.dtype}; give numbers of shape (n, 3), "
            "or (n, 6) with normals"
        )
    return array.astype(np.float64)


def _damaged(path: Path) -> ScanError:
    return ScanError(
        f"{path.name}: this is no complete NumPy file of plain numbers; save it again with numpy.save"
    )
