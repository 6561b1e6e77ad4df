"""Solids to pack, made with build123d when a test asks."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def write(shape: Any, path: Path) -> Path:
    """A .brep or .step file."""
    from build123d import export_brep, export_step

    (export_brep if path.suffix == ".brep" else export_step)(shape, path)
    return path


def as_splines(shape: Any) -> Any:
    """The same with every face a B-spline."""
    from build123d import Compound
    from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert

    return Compound(BRepBuilderAPI_NurbsConvert(shape.wrapped).Shape())
