"""From the name of a kind to its class."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from sed2cad.primitives.base import Primitive

_CLASSES = {
    "plane": "Plane",
    "cylinder": "Cylinder",
    "cone": "Cone",
    "sphere": "Sphere",
    "torus": "Torus",
    "bspline": "BSplineSurface",
    "extrusion": "Extrusion",
    "revolution": "Revolution",
    "loose": "Loose",
}

SWEPT_KINDS: tuple[str, ...] = ("extrusion", "revolution")  # what a patch of kind "bspline" may turn out to be
ANALYTIC_KINDS: tuple[str, ...] = ("plane", "cylinder", "cone", "sphere", "torus")
KINDS: tuple[str, ...] = (*ANALYTIC_KINDS, "bspline")  # of patches


def primitive_class(kind: str) -> type[Primitive]:
    """The class whose `kind` this is. ValueError for an unknown kind."""
    if kind not in _CLASSES:
        raise ValueError(f"There is no primitive '{kind}'; there are {', '.join(_CLASSES)}.")
    module = import_module(f"sed2cad.primitives.{kind}")
    found: type[Primitive] = getattr(module, _CLASSES[kind])
    return found


def read_primitive(kind: str, parameters: dict[str, Any]) -> Primitive:
    """The primitive that gave these parameters. ValueError where they make no sense."""
    if kind == "bspline" and parameters.get("base") == "net":
        from sed2cad.primitives.net_surface import NetSurface

        return NetSurface.from_parameters(parameters)
    return primitive_class(kind).from_parameters(parameters)
