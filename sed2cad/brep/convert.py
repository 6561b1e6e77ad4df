"""From the stored solid to build123d and to STEP."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sed2cad.brep.kernel import from_bytes, solids
from sed2cad.brep.step import write_step

if TYPE_CHECKING:
    from build123d import Compound, Solid


def solid_from_brep(brep: bytes) -> Solid | Compound:
    """The solid for build123d; a Compound when there are several."""
    from build123d import Compound, Solid  # slow to import

    shape = from_bytes(brep)
    found = solids(shape)
    return Solid(found[0]) if len(found) == 1 else Compound(shape)


def export_step(brep: bytes, face_names: Sequence[str], path: Path, name: str, unit: str) -> None:
    """Write the STEP file of a solid in `unit`: the product is called `name`, its faces `face_names`."""
    write_step(from_bytes(brep), path, face_names, product=name, unit=unit)
