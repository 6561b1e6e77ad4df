"""Scans of a CAD file as scanners of five kinds would make them, and the true patches of their points."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gpytoolbox import squared_distance
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.evaluation.relations import true_patches
from sed2cad.evaluation.trial import SAME_POINT, Trial
from sed2cad.network.types import PLANE
from sed2cad.primitives.base import Patch
from sed2cad.scan.raw import RawScan
from sed2cad.scan.read import read_scan
from sed2cad.scan.scan import Array, Scan
from sed2cad.training.augment import MAX_TURN, turn
from sed2cad.training.cad import part_and_frame
from sed2cad.training.cad_mesh import Frame, read_shape
from sed2cad.training.labelled_part import LabelledCloud, LabelledPart

CLEAN, NOISY, DENSE, MESH, TABLE = KINDS = ("clean", "noisy", "dense", "mesh", "table")

POINTS = 10_000  # of clean and noisy scans
DENSE_POINTS = 200_000
OUTLIERS = 200  # among the dense points
REACH = 1.1  # radii: outliers lie in a cube that reaches so far from the centre to each side
NOISE = 0.01  # radii: largest displacement along the normal of a noisy scan
DENSE_NOISE = 0.001  # radii: standard deviation in each coordinate of a dense scan
DEFLECTION = 0.001  # radii: of a mesh from the faces
SAME_PLANE = 1e-3  # unit frame
ANGLE = 0.2  # radians: largest turn of a face over a triangle of a mesh


@dataclass(frozen=True)
class MadeScan:
    """A scan and its truth. R, the unit of noise, is the radius of the sphere about the bounding box's centre."""

    raw: RawScan  # in the part's own unit and frame
    part: LabelledPart  # unit frame
    frame: Frame  # of the part
    cloud: LabelledCloud | None  # the exact points of raw's first ones, row by row; None for a mesh


def make_scan(path: Path, kind: str, seed: int = 0) -> MadeScan:
    """A scan of a .step, .stp or .brep file. Raises OSError or ValueError for an unusable one.

    clean: points exactly on the faces, with normals. noisy: uniform noise along the normal, normals turned by up to
    MAX_TURN degrees. dense: no normals, Gaussian noise, outliers. mesh: triangles. table: clean, but for the face that
    the part stands on.
    """
    part, frame = part_and_frame(path)
    if kind == MESH:
        return MadeScan(_triangulated(path, part, frame), part, frame, None)
    rng = np.random.default_rng(seed)
    radius = _radius(part)
    cloud = part.sample(rng, DENSE_POINTS - OUTLIERS if kind == DENSE else POINTS)
    if kind == TABLE:
        shown = ~_on(part, standing_face(part), cloud)
        cloud = LabelledCloud(**{name: getattr(cloud, name)[shown] for name in LabelledCloud.__dataclass_fields__})
    points, normals = cloud.points.astype(np.float64), cloud.normals.astype(np.float64)
    given: Array | None = normals
    if kind == NOISY:
        points = points + normals * rng.uniform(-NOISE * radius, NOISE * radius, (len(points), 1))
        given = turn(normals, MAX_TURN, rng)
    elif kind == DENSE:
        stray = rng.uniform(-REACH * radius, REACH * radius, (OUTLIERS, 3))
        points = np.vstack([points + rng.normal(0, DENSE_NOISE * radius, points.shape), stray])
        given = None
    return MadeScan(RawScan(points * frame.size + frame.centre, given, name=path.stem), part, frame, cloud)


def standing_face(part: LabelledPart) -> int:
    """The largest flat face with all of the part on its inner side. ValueError where there is none."""
    corners = part.nodes[part.triangles].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.bincount(part.face, np.linalg.norm(across, axis=1), minlength=len(part.type))
    for face in np.argsort(-area):
        if part.type[face] == PLANE and _above(part, int(face), part.nodes.astype(np.float64)).max() < SAME_PLANE:
            return int(face)
    raise ValueError("the part has no flat face to stand on")


def _above(part: LabelledPart, face: int, points: Array) -> Array:
    """Heights (n,) of points (n, 3) over a flat face."""
    return np.asarray(part.side[face] * (points - part.origin[face]) @ part.axis[face])


def _on(part: LabelledPart, face: int, cloud: LabelledCloud) -> NDArray[np.bool_]:
    """Which points of a cloud lie on a flat face or beside it in its plane."""
    flat = np.abs(_above(part, face, cloud.points.astype(np.float64))) < SAME_PLANE
    return np.asarray(flat & (cloud.normals @ part.axis[face] * part.side[face] > 0.99))


def patches_of(made: MadeScan, scan: Scan) -> list[Patch]:
    """The true patches of a prepared scan; a point has its face from when it was made, outliers have none."""
    points = scan.frame.to_world(scan.points)
    if made.cloud is None:
        cloud, row = _labelled(made, made.frame.apply(points), scan.normals), np.arange(len(points))
    else:
        cloud = made.cloud
        distance, row = cKDTree(points).query(made.raw.points[: len(cloud.points)])
        row = np.where(distance <= SAME_POINT * made.frame.size, row, -1)
    return true_patches(cloud, Trial(scan, row, 0.0))[1]


def _labelled(made: MadeScan, points: Array, normals: Array) -> LabelledCloud:
    """Labels of points (n, 3), unit frame, by the nearest triangle of the part."""
    part = made.part
    nodes, triangles = part.nodes.astype(np.float64), part.triangles.astype(np.int64)
    face = part.face[squared_distance(points, nodes, F=triangles, use_cpp=True, use_aabb=True)[1]]
    return part.cloud(points, normals, normals, face)


def _triangulated(path: Path, part: LabelledPart, frame: Frame) -> RawScan:
    """The part's triangles as an STL file holds them."""
    from build123d import Compound, export_stl  # slow to import
    from OCP.BRepTools import BRepTools

    shape = read_shape(path)
    BRepTools.Clean_s(shape)  # a file may hold a mesh of its own
    with tempfile.TemporaryDirectory(prefix="sed2cad-") as folder:
        file = Path(folder) / f"{path.stem}.stl"
        export_stl(Compound(shape), file, DEFLECTION * _radius(part) * frame.size, ANGLE)
        return read_scan(file)


def _radius(part: LabelledPart) -> float:
    """R in the unit frame, whose origin is the centre of the box."""
    return float(np.linalg.norm(part.nodes, axis=1).max())
