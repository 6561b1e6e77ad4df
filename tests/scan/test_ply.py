"""PLY files in every variant that the format allows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sed2cad.errors import ScanError
from sed2cad.scan.ply import TYPES, read_ply
from tests.parts import box_points, write_ply

ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def ply(path: Path, encoding: str, elements: list[tuple[str, list[tuple[str, str]], list[tuple]]]) -> Path:
    """Write a PLY file value by value; a property type "list uchar int" takes a tuple."""
    head, body = ["ply", f"format {encoding} 1.0", "comment made by hand", "obj_info none"], b""
    for name, properties, rows in elements:
        head += [f"element {name} {len(rows)}"] + [f"property {kind} {title}" for kind, title in properties]
        for row in rows:
            words = []
            for (kind, _), value in zip(properties, row):
                if kind.startswith("list"):
                    _, count, kind = kind.split()
                    words += [(count, len(value))] + [(kind, v) for v in value]
                else:
                    words.append((kind, value))
            if encoding == "ascii":
                body += " ".join(f"{value!r}" for _, value in words).encode() + b"\n"
            else:
                body += b"".join(np.array(v, ORDERS[encoding] + TYPES[k]).tobytes() for k, v in words)
    path.write_bytes("\n".join([*head, "end_header", ""]).encode() + body)
    return path


@pytest.mark.parametrize("encoding", ["ascii", *ORDERS])
@pytest.mark.parametrize("kind", ["float", "double", "float32", "float64"])
def test_any_order_and_extra_columns(tmp_path: Path, encoding: str, kind: str) -> None:
    names = ["red", "nz", "z", "quality", "x", "ny", "nx", "y"]
    kinds = ["uchar", kind, kind, "ushort", kind, "float", "double", kind]
    rows = [(i, 0.25, 3.0 * i, 7 * i, 1.5 * i, 0.5, -1.0, 2.0 * i) for i in range(60)]
    raw = read_ply(ply(tmp_path / "a.ply", encoding, [("vertex", list(zip(kinds, names)), rows)]))
    np.testing.assert_allclose(raw.points, np.arange(60)[:, None] * [1.5, 2.0, 3.0])
    np.testing.assert_allclose(raw.normals, np.tile([-1.0, 0.5, 0.25], (60, 1)))
    assert raw.mesh is None


@pytest.mark.parametrize("encoding", ["ascii", *ORDERS])
@pytest.mark.parametrize("mixed", [False, True])
def test_mesh_after_another_element_with_lists(tmp_path: Path, encoding: str, mixed: bool) -> None:
    faces = QUADS[:5] + ([QUADS[5][:3], (1, 7, 3)] if mixed else [QUADS[5]])
    elements = [
        ("camera", [("list uchar float", "view"), ("int", "id")], [((1.0, 2.0), 1), ((3.0,), 2)]),
        ("vertex", [("float", "x"), ("float", "y"), ("float", "z")], [tuple(map(float, v)) for v in CUBE]),
        ("face", [("uchar", "flag"), ("list uchar int", "vertex_indices")], [(1, f) for f in faces]),
    ]
    raw = read_ply(ply(tmp_path / "cube.ply", encoding, elements))
    assert raw.mesh is not None and raw.mesh.faces.shape == (12, 3)
    assert raw.mesh.volume() == pytest.approx(1.0)


@settings(max_examples=20, deadline=None)
@given(arrays(np.float32, (60, 6), elements=st.floats(-1e6, 1e6, width=32)))
def test_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, table: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("ply") / "r.ply"
    write_ply(path, table[:, :3], table[:, 3:])
    raw = read_ply(path)
    np.testing.assert_array_equal(np.hstack([raw.points, raw.normals]), table)


def test_carriage_returns_in_the_header(tmp_path: Path) -> None:
    path = tmp_path / "crlf.ply"
    write_ply(path, box_points(60)[0])
    head, body = path.read_bytes().split(b"end_header\n", 1)
    path.write_bytes(head.replace(b"\n", b"\r\n") + b"end_header\r\n" + body)
    assert read_ply(path).points.shape == (60, 3)


@pytest.mark.parametrize("cut", [1, 12, 500])
def test_says_how_much_is_missing(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "cut.ply"
    write_ply(path, *box_points(60))
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(ScanError, match=rf"cut\.ply: the file is cut short, {cut} bytes of its 60 vertex"):
        read_ply(path)


def test_cut_ascii(tmp_path: Path) -> None:
    rows = [(1.0, 2.0, float(i)) for i in range(60)]
    path = ply(tmp_path / "a.ply", "ascii", [("vertex", [("float", c) for c in "xyz"], rows)])
    path.write_text(path.read_text().rsplit(" ", 1)[0])
    with pytest.raises(ScanError, match="1 numbers of its 60 vertex rows are missing"):
        read_ply(path)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (b"float x", b"text x", "cannot read the header line 'property text x'"),
        (b"element vertex 60", b"element vertex many", "cannot read the header line"),
        (b"binary_little_endian", b"binary_middle_endian", "unknown PLY format"),
        (b"property float z\n", b"", "no x, y and z"),
        (b"element vertex", b"element point", "has no vertices"),
        (b"end_header", b"", "cut short within its PLY header"),
    ],
)
def test_broken_headers(tmp_path: Path, old: bytes, new: bytes, sentence: str) -> None:
    path = tmp_path / "b.ply"
    write_ply(path, np.zeros((60, 3)))
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(ScanError, match=sentence):
        read_ply(path)


def test_a_face_with_a_vertex_that_is_not_there(tmp_path: Path) -> None:
    elements = [
        ("vertex", [("float", c) for c in "xyz"], [tuple(map(float, v)) for v in CUBE]),
        ("face", [("list uchar int", "vertex_index")], [((0, 1, 8),)]),
    ]
    with pytest.raises(ScanError, match="names a vertex that is not in the file"):
        read_ply(ply(tmp_path / "f.ply", "ascii", elements))
