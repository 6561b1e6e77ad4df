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


def wavy_bar() -> Any:
    """10 x 5 x 4, the side towards y a spline extruded along z."""
    from build123d import Edge, Face, Polyline, Solid, Wire

    bend = Edge.make_spline([(0, 0, 0), (3, 1, 0), (6, -1, 0), (10, 0, 0)])
    sides = Polyline((10, 0, 0), (10, -5, 0), (0, -5, 0), (0, 0, 0)).edges()
    return Solid.extrude(Face(Wire([bend, *sides])), (0, 0, 4))


def plate_with_holes() -> Any:
    """40 x 20 x 6 with two bores of radius 4."""
    from build123d import Align, Box, Cylinder, Pos

    centred = (Align.CENTER, Align.CENTER, Align.CENTER)
    plate = Box(40, 20, 6, align=centred)
    for x in (-10, 10):
        plate = plate - Pos(x, 0, 0) * Cylinder(4, 10, align=centred)
    return plate
