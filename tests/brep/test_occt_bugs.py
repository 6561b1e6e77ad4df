"""What OCP 7.9.3 does wrongly or surprisingly. A test that fails here says that a workaround can go."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeSphere
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

from sed2cad.brep.kernel import faces, numbers
from sed2cad.brep.measure import tessellate
from sed2cad.brep.step import read_step, write_step


def test_equal_shapes_are_not_equal() -> None:
    """== is identity of the Python objects, so faces cannot be dict keys; `numbers` asks the kernel."""
    box = BRepPrimAPI_MakeBox(1.0, 2.0, 3.0).Shape()
    first, again = faces(box)[0], faces(box)[0]
    assert first.IsSame(again)
    assert not first == again
    assert numbers(faces(box), [again.Reversed()]) == [0]


def test_step_switches_do_not_exist_before_the_first_controller() -> None:
    """Setting one is silently refused, so `_prepare` makes the controller first."""
    code = (
        "from OCP.Interface import Interface_Static as s\n"
        "from OCP.STEPControl import STEPControl_Controller as c\n"
        "before = s.SetIVal_s('write.step.schema', 4)\n"
        "c.Init_s()\n"
        "print(before, s.SetIVal_s('write.step.schema', 4))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert ran.stdout.split() == ["False", "True"]


def test_the_step_writer_counts_products_up(tmp_path: Path) -> None:
    """The same solid is another file each time, so `_label` names the product."""
    write_step(BRepPrimAPI_MakeBox(1.0, 2.0, 3.0).Shape(), tmp_path / "quiet.step")  # silences the kernel
    texts = []
    for k in range(2):
        writer = STEPControl_Writer()
        writer.Transfer(BRepPrimAPI_MakeBox(1.0, 2.0, 3.0).Shape(), STEPControl_AsIs)
        writer.Write(str(tmp_path / f"{k}.step"))
        texts.append((tmp_path / f"{k}.step").read_text().split("DATA;")[1])
    assert texts[0] != texts[1]


def test_a_tessellation_is_coarser_than_asked_for() -> None:
    """Hence the slack with which `deviations` tells the inside of a face from what lies beyond its border."""
    ball = BRepPrimAPI_MakeSphere(3.0).Shape()
    mesh = tessellate(ball, 0.03)
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    sagitta = 3.0 - np.linalg.norm(middles, axis=1).min()
    assert 0.03 < sagitta < 0.09


def test_a_unit_is_a_scale_unless_the_session_has_it_too(tmp_path: Path) -> None:
    """`write.step.unit` alone multiplies the coordinates; the session's unit must be the same."""
    box = BRepPrimAPI_MakeBox(1.0, 2.0, 3.0).Shape()
    write_step(box, tmp_path / "inch.step", unit="in")
    write_step(box, tmp_path / "mm.step", unit="mm")  # the switch of the first does not stick
    assert math.isclose(_length(tmp_path / "inch.step") / _length(tmp_path / "mm.step"), 25.4, rel_tol=1e-9)


def _length(path: Path) -> float:
    """The longest edge of the box in a file, mm."""
    return float(np.ptp(tessellate(read_step(path), 0.1).vertices, axis=0).max())
