"""An open shell: a solid without some of its faces."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

from OCP.TopoDS import TopoDS_Shape

from sed2cad.brep.attempt import AssemblyResult, Opening
from sed2cad.brep.gate import through_step
from sed2cad.brep.kernel import compound, faces, from_bytes, is_valid, numbers, solids, to_bytes
from sed2cad.brep.solid import shell_of
from sed2cad.errors import AssemblyError


def opened(job: Opening) -> AssemblyResult:
    """The solid without these faces. AssemblyError where what is left is not valid, here or back from a STEP file."""
    shape = without_faces(from_bytes(job.solid.brep), job.faces)
    if not is_valid(shape) or through_step(shape).shape is None:
        raise AssemblyError("the CAD kernel finds the open shell invalid")
    gate = replace(job.solid.gate, closed=False, volume=math.nan)  # all else was checked on the closed solid
    kept = tuple(face for k, face in enumerate(job.solid.faces) if k not in job.faces)
    return replace(job.solid, brep=to_bytes(shape), faces=kept, gate=gate)


def without_faces(shape: TopoDS_Shape, left_out: Collection[int]) -> TopoDS_Shape:
    """The solids of a shape, each as a shell if it has some of the faces: these are left out."""
    parts: list[TopoDS_Shape] = []
    every = faces(shape)
    for solid in solids(shape):
        own = faces(solid)
        left = [face for face, number in zip(own, numbers(every, own)) if number not in left_out]
        parts.append(solid if len(left) == len(own) else shell_of(left))
    return compound(parts)
