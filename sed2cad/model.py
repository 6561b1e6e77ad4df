"""The result: primitives and topology, the solid they make, and how it was checked.

A variant is the same assembly with a changed primitive, so the model is all that a script needs: it is saved
as JSON beside the STEP file, report and editable document in one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sed2cad.brep.attempt import Export
from sed2cad.brep.jobs import step_file
from sed2cad.brep.worker import Failure, run_isolated
from sed2cad.errors import AssemblyError, UsageError
from sed2cad.files import write_bytes
from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.primitives.names import primitive_names
from sed2cad.primitives.registry import read_primitive
from sed2cad.report.report import Report
from sed2cad.scan.scan import Frame
from sed2cad.topology.model import Topology

if TYPE_CHECKING:
    from build123d import Compound, Shell, Solid

Array = NDArray[np.float64]

_EXPORT_SECONDS = 60.0


@dataclass(frozen=True)
class CadModel:
    """A reconstructed part. Lengths outside `fitted` and `topology` are in the scan's own unit and frame."""

    name: str
    unit: str  # of the coordinates: "mm", "cm", "m", "in"
    frame: Frame
    fitted: tuple[FittedPatch, ...]  # unit frame
    topology: Topology  # unit frame
    brep: bytes  # the solid, world coordinates
    face_names: tuple[str, ...]  # of the faces of `brep`, in order
    report: Report
    open_at: tuple[int, ...] = ()  # patches whose faces are left out: the shell is open there
    names: tuple[str, ...] = field(init=False)  # of the primitives: plane_1, cylinder_1, ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", primitive_names(self.fitted))

    @property
    def primitives(self) -> dict[str, Primitive]:
        """The surfaces by name, in world coordinates."""
        scale, origin = self.frame.scale, self.frame.origin
        return {n: f.primitive.scaled(scale, origin) for n, f in zip(self.names, self.fitted)}

    @property
    def solid(self) -> Solid | Compound | Shell:
        """The solid for build123d; a Compound when the scan shows several bodies, a Shell where it is open."""
        from sed2cad.brep.convert import solid_from_brep

        return solid_from_brep(self.brep)

    def vary(self, **changes: Mapping[str, Any]) -> CadModel:
        """A new model on the same topology: `model.vary(cylinder_3={"radius": 6.0})`.

        UsageError for an unknown primitive or parameter, AssemblyError when the changed surfaces no longer make
        a closed valid solid.
        """
        from sed2cad.assembly import reassemble

        if not self.topology.regions:
            raise UsageError(f"{self.name}: the solid is made of facets and has no parameters to vary")
        fitted = list(self.fitted)
        for name, parameters in changes.items():
            if name not in self.names:
                raise UsageError(f"there is no primitive {name!r}: this model has {', '.join(self.names)}")
            i = self.names.index(name)
            fitted[i] = replace(fitted[i], primitive=self._changed(name, parameters))
        try:
            made = reassemble(self.frame, fitted, self.topology, self.open_at)
        except AssemblyError as error:
            raise AssemblyError(f"{self.name}: the changed surfaces make no valid solid ({error})") from error
        return replace(
            self, fitted=made.fitted, brep=made.solid.brep, face_names=made.face_names,
            report=self.report.for_variant(made.solid, changes),
        )

    def _changed(self, name: str, changes: Mapping[str, Any]) -> Primitive:
        """The primitive `name` with some parameters replaced, in the unit frame."""
        primitive = self.primitives[name]
        parameters = primitive.parameters()
        unknown = sorted(set(changes) - set(parameters))
        if unknown or not parameters:
            raise UsageError(f"{name} has no parameter {', '.join(unknown)}: it has {', '.join(parameters)}")
        try:
            changed = read_primitive(primitive.kind, {**parameters, **changes})
        except ValueError as error:
            raise UsageError(f"{name}: {error}") from error
        scale, origin = self.frame.scale, self.frame.origin
        return changed.scaled(1 / scale, -origin / scale)

    def export_step(self, path: str | Path) -> None:
        """Write the STEP file, whole or not at all. AssemblyError where the kernel fails on it."""
        export = Export(self.brep, self.face_names, self.name, self.unit)
        written = run_isolated(step_file, export, _EXPORT_SECONDS)
        if isinstance(written, Failure):
            raise AssemblyError(f"{self.name}: the solid could not be written as STEP ({written.sentence})")
        write_bytes(Path(path), written)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON: report and editable document in one."""
        from sed2cad.report.document import save_model

        save_model(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> CadModel:
        """Read a model that `save` wrote. UsageError where the file is no such model."""
        from sed2cad.report.document import load_model

        return load_model(Path(path))

    def write_script(self, path: str | Path, document: str | Path) -> None:
        """Write a Python script with the part's dimensions at its top that makes the part and its variants.

        `document` is where `save` wrote this model; the script reads it.
        """
        from sed2cad.report.script import write_script

        write_script(self, Path(path), Path(document))
