"""sed2cad: scan to STEP.

    import sed2cad
    model = sed2cad.reconstruct("scan.ply")
    model.export_step("part.step")
    model.vary(cylinder_3={"radius": 6.0}).export_step("variant.step")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sed2cad.model import CadModel
    from sed2cad.pipeline import reconstruct
    from sed2cad.scan.read import read_scan
    from sed2cad.settings import Settings

__version__ = "0.1.0"
__all__ = ["CadModel", "Settings", "read_scan", "reconstruct"]

_HOMES = {
    "CadModel": "sed2cad.model",
    "Settings": "sed2cad.settings",
    "read_scan": "sed2cad.scan.read",
    "reconstruct": "sed2cad.pipeline",
}


def __getattr__(name: str) -> Any:
    """Import on first use: numpy, scipy and the CAD kernel are slow to load."""
    if name not in _HOMES:
        raise AttributeError(f"module 'sed2cad' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
