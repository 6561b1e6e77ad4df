"""Small parts with known dimensions, and scans of them. Lengths in mm.

    python tests/parts.py      makes tests/data/bracket.ply again, the scan that the README starts with
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DATA = Path(__file__).with_name("data")


def bracket() -> Any:
    """An angle of 60 x 40 x 50 with walls of 8, bores of radius 5 (foot) and 8 (wall), a fillet of 6."""
    from build123d import Axis, Box, Cylinder, Pos, Rot, fillet

    corner = Pos(30, 20, 0)
    part = corner * (Pos(0, 0, 4) * Box(60, 40, 8) + Pos(-26, 0, 25) * Box(8, 40, 50))
    inner = part.edges().filter_by(Axis.Y).sort_by_distance((8, 20, 8))[0]
    part = fillet(inner, 6)
    part -= Pos(42, 20, 4) * Cylinder(5, 20)
    part -= Pos(4, 20, 32) * Rot(0, 90, 0) * Cylinder(8, 20)
    return part.solid()


def stepped_shaft() -> Any:
    """Cylinders of radius 10 and 6, each 20 long, the thin end with a chamfer of 2 (a cone)."""
    from build123d import Axis, Cylinder, GeomType, Pos, chamfer

    part = Pos(0, 0, 10) * Cylinder(10, 20) + Pos(0, 0, 30) * Cylinder(6, 20)
    end = part.edges().filter_by(GeomType.CIRCLE).sort_by(Axis.Z)[-1]
    return chamfer(end, 2).solid()


def flange() -> Any:
    """A disk of radius 30, 8 thick, a hub of radius 14 up to 22, a bore of 8, six of 3 on a circle of 22."""
    from build123d import Cylinder, Pos, Rot

    part = Pos(0, 0, 4) * Cylinder(30, 8) + Pos(0, 0, 11) * Cylinder(14, 22) - Pos(0, 0, 11) * Cylinder(8, 30)
    for k in range(6):
        part -= Rot(0, 0, 60 * k) * Pos(22, 0, 4) * Cylinder(3, 20)
    return part.solid()


def round_pin() -> Any:
    """A cylinder of radius 8 and length 24 with a hemisphere at its end."""
    from build123d import Cylinder, Pos, Sphere

    return (Pos(0, 0, 12) * Cylinder(8, 24) + Pos(0, 0, 24) * Sphere(8)).solid()


PARTS = {"bracket": bracket, "stepped_shaft": stepped_shaft, "flange": flange, "round_pin": round_pin}


def triangles(solid: Any, deflection: float = 0.001) -> tuple[Array, NDArray[np.int64]]:
    """Corners (v, 3) and triangles (f, 3) of a solid, outwards; edges' corners appear once for each face."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    BRepMesh_IncrementalMesh(solid.wrapped, deflection, False, 0.03, False)
    vertices, faces, count = [], [], 0
    for face in solid.faces():
        where = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face.wrapped, where)
        move = where.Transformation()
        nodes = [mesh.Node(k).Transformed(move) for k in range(1, mesh.NbNodes() + 1)]
        corners = np.array([mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)]) - 1 + count
        if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
            corners = corners[:, ::-1]
        vertices += [(p.X(), p.Y(), p.Z()) for p in nodes]
        faces.append(corners)
        count = len(vertices)
    return np.array(vertices), np.vstack(faces).astype(np.int64)


def sample_scan(solid: Any, n: int, noise: float = 0.0, seed: int = 0) -> tuple[Array, Array]:
    """n points spread evenly over a solid and their outward normals, both (n, 3).

    The points are exact to 0.001 mm; noise is the standard deviation of their way along the normal in mm.
    """
    rng = np.random.default_rng(seed)
    vertices, faces = triangles(solid)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    pick = rng.choice(len(faces), n, p=area / area.sum())
    u, v = rng.random((2, n, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[pick] + u * (b - a)[pick] + v * (c - a)[pick]
    normals = cross[pick] / area[pick, None]
    return points + rng.normal(0, noise, (n, 1)) * normals if noise else points, normals


def box_points(n: int, size: tuple[float, float, float] = (40, 30, 20), seed: int = 0) -> tuple[Array, Array]:
    """n points on a box about the origin and their outward normals, without the CAD kernel."""
    rng = np.random.default_rng(seed)
    extent = np.array(size)
    area = np.repeat([extent[1] * extent[2], extent[0] * extent[2], extent[0] * extent[1]], 2)
    side = rng.choice(6, n, p=area / area.sum())
    normals = np.vstack([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]][side]
    points = rng.uniform(-0.5, 0.5, (n, 3)) * extent
    return np.where(normals != 0, normals * extent / 2, points), normals


def shaft_points(n: int, radius: float = 8, length: float = 40, seed: int = 0) -> tuple[Array, Array]:
    """n points on a cylinder with flat ends and their outward normals, without the CAD kernel."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * math.pi, n)
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    end = rng.random(n) < radius / (radius + length)
    way = np.where(rng.random(n) < 0.5, -1.0, 1.0)
    along = np.where(end, way * length / 2, rng.uniform(-length / 2, length / 2, n))
    away = np.where(end, radius * np.sqrt(rng.random(n)), radius)
    points = out * away[:, None] + along[:, None] * [0, 0, 1]
    return points, np.where(end[:, None], way[:, None] * [0, 0, 1], out)


def write_ply(path: Path, points: Array, normals: Array | None = None) -> None:
    """Binary little-endian floats."""
    data = points if normals is None else np.hstack([points, normals])
    names = ("x", "y", "z", "nx", "ny", "nz")[: data.shape[1]]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(data)}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    path.write_bytes("\n".join(header).encode() + data.astype("<f4").tobytes())


if __name__ == "__main__":
    DATA.mkdir(exist_ok=True)
    write_ply(DATA / "bracket.ply", *sample_scan(bracket(), 10_000))
    print(DATA / "bracket.ply", (DATA / "bracket.ply").stat().st_size, "bytes")
