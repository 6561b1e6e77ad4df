"""Random parts: sound, of every kind of face, and the same bytes from the same number."""

from collections import Counter

import pytest
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepTools import BRepTools
from OCP.GeomAbs import GeomAbs_SurfaceType as Kind
from typer.testing import CliRunner

from sed2cad.cli import app
from sed2cad.training.cad_mesh import read_shape
from sed2cad.training.child import Child
from sed2cad.training.synthetic import part as parts_module
from sed2cad.training.synthetic import random_part, write_parts
from sed2cad.training.synthetic.folder import ATTEMPTS, first_sound
from sed2cad.training.synthetic.settle import rounded, settled
from sed2cad.training.synthetic.shapes import Corner, box, is_sound, outline, regular, rod

SEEDS = range(18)


@pytest.fixture(scope="module")
def some():
    return {seed: random_part(seed) for seed in SEEDS}


def written(part, path):
    BRepTools.Write_s(part.wrapped, str(path))
    return path.read_bytes()


def kinds(part):
    return Counter(BRepAdaptor_Surface(face.wrapped).GetType() for face in part.faces())


def test_parts_are_valid_closed_solids(some):
    for part in some.values():
        assert len(part.solids()) == 1
        assert [shell.wrapped.Closed() for shell in part.shells()] == [True]
        assert BRepCheck_Analyzer(part.wrapped).IsValid()
        assert part.volume > 0
        assert len(part.faces()) <= parts_module.MOST_FACES


def test_every_kind_of_face_occurs(some):
    total = sum((kinds(part) for part in some.values()), Counter())
    wanted = (Kind.GeomAbs_Plane, Kind.GeomAbs_Cylinder, Kind.GeomAbs_Cone, Kind.GeomAbs_Sphere, Kind.GeomAbs_Torus)
    assert all(total[kind] for kind in (*wanted, Kind.GeomAbs_BSplineSurface))
    assert total[Kind.GeomAbs_Plane] > total[Kind.GeomAbs_Cylinder] > total[Kind.GeomAbs_Cone]


def test_parts_differ(some):
    assert len({round(part.volume, 6) for part in some.values()}) == len(some)


def test_command_writes_the_same_bytes_in_other_processes_and_order(some, tmp_path):
    """Parts written here after their predecessors, and by two children that begin in the middle."""
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["synthetic", "3", "-o", str(out), "--seed", "3", "--workers", "2"])
    assert result.exit_code == 0
    assert result.stdout == f"{out}: 3 parts, 0 failed\n"
    paths = sorted(out.iterdir())
    assert [path.name for path in paths] == [f"synthetic_{k:06d}.brep" for k in (3, 4, 5)]
    for seed, path in zip((3, 4, 5), paths):
        assert path.read_bytes() == written(some[seed], tmp_path / "here.brep")
        assert BRepCheck_Analyzer(read_shape(path)).IsValid()
    assert written(random_part(3), tmp_path / "again.brep") == paths[0].read_bytes()


def test_files_that_are_there_are_kept(tmp_path):
    there = tmp_path / "synthetic_000000.brep"
    there.write_text("kept")
    calls = []
    report = write_parts(tmp_path, 1, progress=lambda *call: calls.append(call))
    assert report.parts == [there] and there.read_text() == "kept"
    assert calls == [(1, 1, there.name)]


def test_a_maker_that_fails_falls_through(monkeypatch):
    """Sub-seeds go on until a maker gives a sound part, the same one each time."""
    tried = []

    def maker(dice):
        size = dice.between(1, 9)
        tried.append(size)
        if len(tried) % 3 == 1:
            raise RuntimeError("the kernel gave up")
        return box((0, 0, 0), (size, size, size)) if len(tried) % 3 == 0 else box((0, 0, 0), (1, 1, 1)).shells()[0]

    monkeypatch.setattr(parts_module, "MAKERS", [(maker, 1.0)])
    assert random_part(5).volume == pytest.approx(tried[2] ** 3)
    assert random_part(5).volume == pytest.approx(tried[2] ** 3)
    assert len(tried) == 6 and len(set(tried)) == 3


def test_a_seed_without_a_part_is_an_error(monkeypatch):
    def maker(dice):
        raise RuntimeError("the kernel gave up")

    monkeypatch.setattr(parts_module, "MAKERS", [(maker, 1.0)])
    with pytest.raises(ValueError, match="seed 5"):
        random_part(5)


def test_a_child_that_fails_goes_on_with_the_next_sub_seed(tmp_path):
    tried = []

    def run(seed, attempt, path):
        tried.append((seed, attempt, path))
        return "crashed" if attempt < 2 else ""

    assert first_sound(run, 7, tmp_path) == ""
    assert tried == [(7, attempt, tmp_path) for attempt in range(3)]
    assert first_sound(lambda *_: "crashed", 7, tmp_path) == "crashed"
    assert ATTEMPTS > 3


def test_a_crashed_child_is_replaced():
    import os
    import time

    crash = Child(os._exit)
    assert crash.run(3) == "crashed"
    assert crash.run(3) == "crashed"
    slow = Child(time.sleep, limit=0.2)
    assert slow.run(0.0) == ""
    assert slow.run(5.0) == "took longer than 0 s"
    assert slow.run(0.0) == ""
    slow.close()
    wrong = Child(os.rmdir)
    assert "No such file" in wrong.run("/no/such/folder")
    wrong.close()


def test_corners_are_rounded_by_tangent_arcs():
    """A square of side 2 with corners rounded at 0.5 loses (4 - pi) 0.25; bevelled it loses 4 * 0.125."""
    from math import pi, sqrt

    square = regular(4, sqrt(2), 0.5)
    assert outline(square).area == pytest.approx(4 - (4 - pi) * 0.25)
    bevelled = [Corner(c.x, c.y, 0.5, round=False) for c in square]
    assert outline(bevelled).area == pytest.approx(4 - 4 * 0.125)
    sharp = outline(regular(4, sqrt(2)))
    assert sharp.area == pytest.approx(4)
    assert rod(1, 2).volume == pytest.approx(2 * pi)


def test_numbers_are_rounded_and_the_rest_of_the_text_is_not():
    text = b"V1, (c) 7.9\n1 4.1477840952706474e-33 -0 12\n-0.10000000000000001 0.97825645074362355 1e-07 2e+100 -3 V1.5"
    assert rounded(text) == b"V1, (c) 7.9\n1 0 0 12\n-0.1 0.9782564507 1e-07 2e+100 -3 V1.5"
    assert rounded(b"0.97825645074362344") == rounded(b"0.97825645074362355")
    part = settled(rod(1 / 3, 2))
    assert is_sound(part) and part.volume == pytest.approx(0.6981317008, abs=1e-9)
