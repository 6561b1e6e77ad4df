"""A reconstructed solid against the true part: closed, solved, exact, and how far off.

closed  one or more solids, every shell closed, valid, positive volume
solved  closed, as many solids as the truth, its volume, nowhere far from it, not many more faces (facets do not pass)
        and not much less of its area on planes, cylinders, cones, spheres and tori
exact   solved, and as many faces of every type as the truth, both after merging faces that lie on one surface
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gpytoolbox import squared_distance
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.TopoDS import TopoDS_Shape

from sed2cad.brep.kernel import area, faces, is_closed, is_valid, solids, volume
from sed2cad.primitives.base import Array
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.training.cad_mesh import Mesh, evaluate, read_shape, tessellated
from sed2cad.training.labelled_part import facets

ANALYTIC = ("Plane", "Cylinder", "Cone", "Sphere", "Torus")
VOLUME_ERROR = 0.02
HAUSDORFF = 0.03  # R
FACES = 1.5, 3  # at most so many times the true faces, and so many more
LESS_ANALYTIC = 0.1  # share of the area
SAMPLES = 40_000  # points on each solid
COARSE = 0.01  # cube root of the volume: deflection of the triangles that tell R
DEFLECTION = 2e-4  # R: of the triangles that distances are measured to
ANGLE = 0.2  # radians: largest turn of a face over one of them; allowed more, the kernel covers holes on a few faces
NAN = float("nan")


@dataclass(frozen=True)
class ScoreJob:
    """What is compared."""

    written: Path  # the reconstruction
    truth: Path
    merge: bool = True  # whether faces on one surface are merged before counting; the kernel crashes on a few parts


@dataclass(frozen=True)
class SolidScore:
    """R is the radius of the truth's sphere about its box's centre. NaN: could not be measured."""

    closed: bool
    solids: int
    true_solids: int
    volume_error: float  # relative
    hausdorff: float  # R: samples of each to the triangles of the other, the largest
    off_rms: float  # R: rms of these distances, both directions together
    faces: Mapping[str, int]  # kernel's name of the type -> count
    true_faces: Mapping[str, int]
    analytic: float  # share of the area
    true_analytic: float
    merged: bool  # whether faces were merged before counting
    error: str = ""  # why it could not be measured

    @property
    def faults(self) -> tuple[str, ...]:
        """Why it is not solved."""
        if not self.closed:
            return ("not closed",)
        most = FACES[0] * sum(self.true_faces.values()) + FACES[1]
        held = {
            "wrong number of solids": self.solids == self.true_solids,
            "volume off": abs(self.volume_error) <= VOLUME_ERROR,
            "Hausdorff off": self.hausdorff <= HAUSDORFF,
            "too many faces": sum(self.faces.values()) <= most,
            "too little analytic area": self.analytic >= self.true_analytic - LESS_ANALYTIC,
        }
        return tuple(name for name, holds in held.items() if not holds)

    @property
    def solved(self) -> bool:
        return not self.faults

    @property
    def exact(self) -> bool:
        return self.solved and not self.differences

    @property
    def differences(self) -> tuple[str, ...]:
        """("Cylinder -4", "Plane +1"): faces that are missing or too many."""
        names = sorted({*self.faces, *self.true_faces})
        more = {name: self.faces.get(name, 0) - self.true_faces.get(name, 0) for name in names}
        return tuple(f"{name} {count:+d}" for name, count in more.items() if count)


@dataclass(frozen=True)
class Measured:
    """What there is to know of a shape."""

    solids: int
    closed: bool
    volume: float
    faces: Mapping[str, int]
    analytic: float  # share of the area
    points: Array  # (SAMPLES, 3) exactly on the faces, evenly spread
    mesh: Mesh


def score_solid(job: ScoreJob) -> SolidScore:
    """Compare two files. OSError, ValueError or a crash of the kernel for a truth that cannot be used."""
    shape = read_shape(job.truth)
    radius = _radius(shape)
    truth = _measured(shape, radius, job.merge)
    try:
        return _compared(_measured(read_shape(job.written), radius, job.merge), truth, radius, job.merge)
    except Exception as error:  # what the kernel raises has no common base
        return _unknown(truth, job.merge, f"{type(error).__name__}: {error}")


def _radius(shape: TopoDS_Shape) -> float:
    """Of the sphere about the centre of the box that holds the shape."""
    nodes = tessellated(shape, faces(shape), COARSE * abs(volume(shape)) ** (1 / 3), ANGLE).nodes
    return float(np.linalg.norm(nodes - (nodes.min(0) + nodes.max(0)) / 2, axis=1).max())


def _measured(shape: TopoDS_Shape, radius: float, merge: bool) -> Measured:
    """A shape; the true R in its unit."""
    closed = bool(solids(shape)) and is_closed(shape) and is_valid(shape) and volume(shape) > 0
    mesh = tessellated(shape, faces(shape), DEFLECTION * radius, ANGLE)
    areas = _areas(_unified(shape) if merge else shape)
    analytic = sum(size for name, size in areas if name in ANALYTIC) / max(sum(size for _, size in areas), 1e-12)
    types = dict(Counter(name for name, _ in areas))
    return Measured(len(solids(shape)), closed, volume(shape), types, analytic, _spread(shape, mesh), mesh)


def _compared(found: Measured, truth: Measured, radius: float, merged: bool) -> SolidScore:
    """What was found, against the truth."""
    off = np.concatenate([_off(found.points, truth.mesh), _off(truth.points, found.mesh)]) / radius
    return SolidScore(
        closed=found.closed,
        solids=found.solids,
        true_solids=truth.solids,
        volume_error=found.volume / truth.volume - 1,
        hausdorff=float(off.max()),
        off_rms=root_mean_square(off),
        faces=found.faces,
        true_faces=truth.faces,
        analytic=found.analytic,
        true_analytic=truth.analytic,
        merged=merged,
    )


def _off(points: Array, mesh: Mesh) -> Array:
    """Distance (n,) of points (n, 3) to the nearest triangle."""
    squared = squared_distance(points, mesh.nodes, F=mesh.triangles, use_cpp=True, use_aabb=True)[0]
    return np.asarray(np.sqrt(squared))


def _unknown(truth: Measured, merged: bool, error: str) -> SolidScore:
    """Nothing could be measured."""
    none: dict[str, int] = {}
    return SolidScore(False, 0, truth.solids, NAN, NAN, NAN, none, truth.faces, NAN, truth.analytic, merged, error)


def _spread(shape: TopoDS_Shape, mesh: Mesh) -> Array:
    """Points (SAMPLES, 3) evenly over the faces of a tessellated shape and exactly on them, always the same ones."""
    rng = np.random.default_rng(0)
    sizes = facets(mesh.nodes, mesh.triangles)[1]
    pick = rng.choice(len(sizes), SAMPLES, p=sizes / sizes.sum())
    weight = rng.dirichlet(np.ones(3), SAMPLES)
    uv = np.einsum("ij,ijk->ik", weight, mesh.uv[mesh.triangles[pick]])
    owner, points = mesh.face[pick], np.empty((SAMPLES, 3))
    for number, face in enumerate(faces(shape)):
        own = np.flatnonzero(owner == number)
        points[own] = evaluate(face, uv[own])[0]
    return points


def _unified(shape: TopoDS_Shape) -> TopoDS_Shape:
    """The shape with touching faces on one surface, and edges on one curve, merged; itself where that fails."""
    try:
        tool = ShapeUpgrade_UnifySameDomain(shape, True, True, False)
        tool.Build()
        return tool.Shape()
    except Exception:  # what the kernel raises has no common base
        return shape


def _areas(shape: TopoDS_Shape) -> list[tuple[str, float]]:
    """Type and area of each face."""
    return [(BRepAdaptor_Surface(face).GetType().name.removeprefix("GeomAbs_"), area(face)) for face in faces(shape)]
