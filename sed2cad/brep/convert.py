"""From the stored solid to build123d and to STEP."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from OCP.TopAbs import TopAbs_SHELL
from OCP.TopoDS import TopoDS

from sed2cad.brep.attempt import Export
from sed2cad.brep.kernel import from_bytes, solids
from sed2cad.brep.step import write_step

if TYPE_CHECKING:
    from build123d import Compound, Shell, Solid


def solid_from_brep(brep: bytes) -> Solid | Compound | Shell:
    """The solid for build123d; a Compound when there are several, a Shell where it is open."""
    from build123d import Compound, Shell, Solid  # slow to import

    shape = from_bytes(brep)
    found = solids(shape)
    if shape.ShapeType() == TopAbs_SHELL:
        return Shell(TopoDS.Shell_s(shape))
    return Solid(found[0]) if len(found) == 1 else Compound(shape)


def step_file(export: Export) -> bytes:
    """The STEP file of a solid."""
    with tempfile.TemporaryDirectory(prefix="sed2cad-") as folder:
        path = Path(folder) / "part.step"
        write_step(from_bytes(export.brep), path, export.face_names, export.product, export.unit)
        return path.read_bytes()
