"""What a file holds, before anything is done to it."""

from __future__ import annotations

from dataclasses import dataclass

from sed2cad.scan.scan import Array, Mesh


class ScanWarning(UserWarning):
    """Something in the scan was mended; the reconstruction goes on."""


@dataclass(frozen=True)
class RawScan:
    """Points as read, in the scan's own coordinates. With a mesh, `points` are its vertices."""

    points: Array  # (n, 3)
    normals: Array | None = None  # (n, 3), any length, perhaps inward
    mesh: Mesh | None = None
    name: str = "scan"  # for messages
