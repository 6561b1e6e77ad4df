"""STEP files: round trip, names, units, the same bytes."""

from __future__ import annotations

from pathlib import Path

import pytest
from build123d import Align, Box
from OCP.BRepAdaptor import BRepAdaptor_Surface

from sed2cad.brep.attempt import Export
from sed2cad.brep.convert import solid_from_brep, step_file
from sed2cad.brep.gate import _changed
from sed2cad.brep.kernel import faces, is_closed, is_valid, measures, solids, volume
from sed2cad.brep.step import read_face_names, read_step, write_step
from sed2cad.errors import AssemblyError
from tests.brep.made import part, result, shape
from tests.geometry import parts


def names(name: str) -> list[str]:
    return [f"{kind}_{k}" for k, kind in enumerate(part(name).kinds, start=1)]


@pytest.mark.parametrize("name", [*sorted(parts.EXACT), "crossing_pipes"])
def test_round_trip(name: str, tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    write_step(shape(name), path, names(name))
    back = read_step(path)
    assert is_valid(back) and is_closed(back)
    assert volume(back) == pytest.approx(part(name).volume, rel=1e-6)
    kinds = [BRepAdaptor_Surface(f).GetType().name.removeprefix("GeomAbs_").lower() for f in faces(back)]
    assert kinds == list(part(name).kinds)
    assert read_face_names(path) == tuple(names(name))


def test_the_same_solid_is_the_same_file(tmp_path: Path) -> None:
    for k in range(2):
        write_step(shape("pill"), tmp_path / f"{k}.step", names("pill"), product="pill")
    first, second = ((tmp_path / f"{k}.step").read_bytes() for k in range(2))
    assert first == second


def test_the_product_has_its_name_and_the_header_no_date(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    write_step(shape("box"), path, product="bracket 7")
    text = path.read_text()
    assert "PRODUCT('bracket 7','bracket 7'" in text
    assert "AUTOMOTIVE_DESIGN" in text
    assert "'2000-01-01T00:00:00'" in text


def test_other_alphabets_do_not_break_the_file(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    write_step(shape("box"), path, ["wände"] * 6, product="Gehäuse")
    assert "PRODUCT('Geh?use'" in path.read_text()
    assert is_valid(read_step(path))


@pytest.mark.parametrize(("unit", "length"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("in", 25.4)])
def test_coordinates_are_in_the_unit_of_the_file(unit: str, length: float, tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    write_step(shape("stepped_shaft"), path, unit=unit)
    assert ",10.)" in path.read_text()  # the radius, as it was given
    assert volume(read_step(path)) == pytest.approx(part("stepped_shaft").volume * length**3, rel=1e-9)
    assert volume(read_step(path, unit)) == pytest.approx(part("stepped_shaft").volume, rel=1e-9)


def test_nothing_is_printed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_step(shape("box"), tmp_path / "part.step")
    read_step(tmp_path / "part.step")
    assert capfd.readouterr() == ("", "")


def test_what_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(AssemblyError, match="could not write"):
        write_step(shape("box"), tmp_path / "missing" / "part.step")


def test_a_file_that_is_no_step_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    path.write_text("no step")
    with pytest.raises(AssemblyError, match="cannot read"):
        read_step(path)


def test_from_a_stored_solid(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    path.write_bytes(step_file(Export(result("pill").brep, tuple(names("pill")), "pill", "mm")))
    assert read_face_names(path) == ("cylinder_1", "plane_2", "sphere_3")


def test_build123d_gets_a_solid_or_a_compound() -> None:
    solid = solid_from_brep(result("box_with_hole").brep)
    assert type(solid).__name__ == "Solid"
    assert solid.volume == pytest.approx(part("box_with_hole").volume)
    both = solid_from_brep(result("two_boxes").brep)
    assert type(both).__name__ == "Compound"
    assert len(solids(both.wrapped)) == 2


def test_faces_that_a_file_does_not_keep_are_told() -> None:
    low, high = (Box(10, 10, height, align=(Align.CENTER, Align.CENTER, Align.MIN)).wrapped for height in (10, 12))
    assert _changed(low, low) == ()
    (kept,) = set(range(6)) - set(_changed(low, high))
    assert measures(faces(low)[kept]) == pytest.approx([0, 0, 0, 10])
    assert _changed(low, Box(50, 50, 50).wrapped) == tuple(range(6))
