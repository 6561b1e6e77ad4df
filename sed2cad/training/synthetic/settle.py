"""The same digits for the same part in every process.

Where a step of the kernel meets two coinciding surfaces, the one it keeps depends on addresses in memory, and the two
differ in the last digit. Numbers rounded far below any tolerance are the same whichever was kept.
"""

from __future__ import annotations

import io
import re

from build123d import Solid
from OCP.BRep import BRep_Builder
from OCP.BRepTools import BRepTools
from OCP.TopoDS import TopoDS_Shape

from sed2cad.training.synthetic.shapes import largest

DIGITS = 10
"""Decimals that are kept, of mm and of directions; the kernel's tolerance is 1e-7."""
NUMBER = re.compile(rb"(?<!\S)(?:-?\d+\.\d+(?:e[-+]?\d+)?|-?\d+e[-+]?\d+|-0)(?!\S)")


def settled(part: Solid) -> Solid:
    """The part with all numbers rounded. Raises ValueError where it cannot be read back."""
    text = io.BytesIO()
    BRepTools.Write_s(part.wrapped, text)
    shape = TopoDS_Shape()
    BRepTools.Read_s(shape, io.BytesIO(rounded(text.getvalue())), BRep_Builder())
    return largest(shape)


def rounded(text: bytes) -> bytes:
    """The text of a .brep file with its numbers rounded; whole numbers are left alone."""
    return NUMBER.sub(lambda match: b"%.15g" % (round(float(match[0]), DIGITS) + 0.0), text)
