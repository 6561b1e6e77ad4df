"""Text, NumPy, STL and OBJ files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sed2cad.errors import ScanError
from sed2cad.scan.read import read_scan
from sed2cad.scan.scan import Array, Mesh
from tests.parts import box_points

POINTS, NORMALS = box_points(80)
CORNERS = np.vstack([np.zeros(3), np.eye(3)])
TETRAHEDRON = Mesh(CORNERS, np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]))


def write(path: Path, table: Array, separator: str = " ", head: str = "", tail: str = "") -> Path:
    rows = [separator.join(f"{value:.17g}" for value in row) + tail for row in table]
    path.write_text(head + "\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".XYZ"])
@pytest.mark.parametrize("separator", [" ", ",", ", ", ";", "\t", "   "])
@pytest.mark.parametrize("head", ["", "# a comment\n\n", "x y z nx ny nz\n", "// a\n80\n"])
def test_text(tmp_path: Path, suffix: str, separator: str, head: str) -> None:
    for table in (POINTS, np.hstack([POINTS, NORMALS])):
        raw = read_scan(write(tmp_path / f"a{suffix}", table, separator, head))
        np.testing.assert_array_equal(raw.points, POINTS)
        if table.shape[1] == 6:
            np.testing.assert_array_equal(raw.normals, NORMALS)
        else:
            assert raw.normals is None


def test_header_names_the_columns(tmp_path: Path) -> None:
    table = np.hstack([NORMALS, POINTS])
    raw = read_scan(write(tmp_path / "a.csv", table, ",", '"Nx","Ny","Nz","X","Y","Z"\n'))
    np.testing.assert_array_equal(raw.points, POINTS)
    np.testing.assert_array_equal(raw.normals, NORMALS)


def test_colours_are_no_normals(tmp_path: Path) -> None:
    table = np.hstack([POINTS, np.full((80, 3), 200.0)])
    assert read_scan(write(tmp_path / "a.xyz", table)).normals is None


def test_decimal_commas(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", POINTS, ";")
    path.write_text(path.read_text().replace(".", ","))
    np.testing.assert_array_equal(read_scan(path).points, POINTS)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("1 2 3\n4 5\n6 7 8\n", r"cannot read '4 5' as 3 numbers"),
        ("1 2 3\n4 five 6\n", r"cannot read '4 five 6' as 3 numbers"),
        ("1 2\n3 4\n", "the lines have 2 numbers"),
        ("# nothing\n", "no points in this file"),
        ("hello\n", "no points in this file"),
    ],
)
def test_bad_text(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "b.xyz").write_text(text)
    with pytest.raises(ScanError, match=rf"b\.xyz: .*{sentence}"):
        read_scan(tmp_path / "b.xyz")


def test_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POINTS.astype(np.float32))
    np.save(tmp_path / "b.npy", np.hstack([POINTS, NORMALS]))
    np.savez(tmp_path / "c.npz", points=POINTS, normals=NORMALS)
    np.savez_compressed(tmp_path / "d.npz", cloud=POINTS)
    for name in "a.npy", "b.npy", "c.npz", "d.npz":
        raw = read_scan(tmp_path / name)
        np.testing.assert_allclose(raw.points, POINTS, rtol=1e-6)
        assert (raw.normals is not None) == (name[0] in "bc")


def test_bad_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "pickle.npy", np.array([{}, None], dtype=object), allow_pickle=True)
    np.save(tmp_path / "flat.npy", POINTS.ravel())
    np.savez(tmp_path / "names.npz", a=POINTS, b=POINTS)
    np.savez(tmp_path / "fewer.npz", points=POINTS, normals=NORMALS[1:])
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "cut.npy").write_bytes((tmp_path / "flat.npy").read_bytes()[:-7])
    for name, sentence in {
        "pickle.npy": "no complete NumPy file", "flat.npy": r"points is an array \(240,\)",
        "names.npz": "no array 'points'", "fewer.npz": "79 normals for 80 points",
        "text.npz": "no complete NumPy file", "cut.npy": "no complete NumPy file",
    }.items():
        with pytest.raises(ScanError, match=sentence):
            read_scan(tmp_path / name)


def write_stl(path: Path, mesh: Mesh, binary: bool) -> Path:
    corners = mesh.vertices[mesh.faces]
    if binary:
        record = np.zeros(len(corners), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
        record["v"] = corners
        path.write_bytes(b"solid but binary".ljust(80) + np.uint32(len(corners)).tobytes() + record.tobytes())
        return path
    loops = ["vertex {} {} {}\n" * 3] * len(corners)
    body = "".join(
        f"facet normal 0 0 0\nouter loop\n{loop.format(*c.ravel())}endloop\nendfacet\n"
        for loop, c in zip(loops, corners)
    )
    path.write_text(f"solid a\n{body}endsolid a\n")
    return path


@pytest.mark.parametrize("binary", [True, False])
def test_stl(tmp_path: Path, binary: bool) -> None:
    path = write_stl(tmp_path / "t.stl", TETRAHEDRON, binary)
    mesh = read_scan(path).mesh
    assert mesh is not None and mesh.volume() == pytest.approx(1 / 6)
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(ScanError, match=r"t\.stl: the file is cut short"):
        read_scan(path)


def test_obj(tmp_path: Path) -> None:
    lines = ["mtllib a.mtl", "o part"] + [f"v {x} {y} {z}" for x, y, z in TETRAHEDRON.vertices]
    lines += ["vt 0 0", "vn 0 0 1", "usemtl red"]
    lines += ["f 1/1 3/1 2/1", "f 1//1 2//1 4//1", "f -4/1/1 -1/1/1 -2/1/1", "f 2 3 4"]
    (tmp_path / "t.obj").write_text("\n".join(lines))
    mesh = read_scan(tmp_path / "t.obj").mesh
    assert mesh is not None and mesh.volume() == pytest.approx(1 / 6)


def test_obj_points_with_normals(tmp_path: Path) -> None:
    rows = np.hstack([POINTS, NORMALS]).tolist()
    lines = [f"v {x} {y} {z}\nvn {a} {b} {c}" for x, y, z, a, b, c in rows]
    (tmp_path / "p.obj").write_text("\n".join(lines))
    raw = read_scan(tmp_path / "p.obj")
    np.testing.assert_array_equal(raw.points, POINTS)
    np.testing.assert_array_equal(raw.normals, NORMALS)
    assert raw.mesh is None


@pytest.mark.parametrize("text", ["v 1 2\n", "v 1 2 3\nf 1 2 x\n", "v 1 2 3\nf 1 2 9\n", "hello\n"])
def test_bad_obj(tmp_path: Path, text: str) -> None:
    (tmp_path / "b.obj").write_text(text)
    with pytest.raises(ScanError, match=r"b\.obj: "):
        read_scan(tmp_path / "b.obj")
