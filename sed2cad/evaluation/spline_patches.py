"""Freeform fits to the true B-spline patches of real parts, without noise."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sed2cad.evaluation.pool import of_each
from sed2cad.evaluation.tables import aligned
from sed2cad.fitting import fit
from sed2cad.network.types import BSPLINE
from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.training.cad_mesh import Frame, evaluate, faces_of, mesh_of, read_shape
from sed2cad.training.dataset import load_part, parts_in
from sed2cad.training.labelled_part import LabelledPart

POINTS = 5_000  # of each patch that the fit sees
CLOSE = 1e-4  # rms over the size that is asked for
_PROBES = 2_000  # of each patch that it is measured on: others
_WORST = 12  # rows of the table

Fitter = Callable[[str, Array, Array, float], tuple[Primitive, float, Array] | None]


@dataclass(frozen=True)
class TrueSpline:
    """A B-spline patch of a part: exact points in the part's unit frame, and normals."""

    part: str
    patch: int  # its number in the part
    size: float  # longest side of its box
    points: Array  # (n, 3), to be fitted
    normals: Array  # (n, 3)
    probes: Array  # (m, 3), other points of the patch


@dataclass(frozen=True)
class SplinePatchScores:
    """The fit of one patch. Deviations are those of the probes, over the size of the part; infinite for no fit."""

    part: str
    patch: int
    size: float  # of the patch, over that of the part
    base: str  # of the fit
    controls: int
    rms: float
    largest: float
    rms_of_patch: float  # rms over the size of the patch
    seconds: float


def score_spline_patches(
    data: Path | Sequence[Path], points: int = POINTS, fitter: Fitter = fit, workers: int = 1
) -> tuple[SplinePatchScores, ...]:
    """Fit each true B-spline patch of parts (a folder, or files): packed ones, or CAD files.

    The points of packed parts lie on bulged triangles (median rms 4e-6 off the surface, a few patches 1e-4); those
    of CAD files are exact. UsageError for a folder without parts.
    """
    files = parts_in(data, cad=True) if isinstance(data, Path) else list(data)
    score = functools.partial(_score_part, points=points, fitter=fitter)
    return tuple(row for rows in of_each(score, files, workers) for row in rows)


def _score_part(file: Path, points: int, fitter: Fitter) -> list[SplinePatchScores]:
    return [score_patch(patch, fitter) for patch in true_splines(file, points)]


def score_patch(patch: TrueSpline, fitter: Fitter = fit) -> SplinePatchScores:
    """One fit without noise."""
    start = time.perf_counter()
    found = fitter("bspline", patch.points, patch.normals, 0.0)
    seconds = time.perf_counter() - start
    gaps = np.abs(found[0].distance(patch.probes)) if found else np.array([np.inf])
    base, controls = (_shape(found[0]) if found else ("none", 0))
    rms = root_mean_square(gaps)
    largest, of_patch = float(gaps.max()), rms / patch.size
    return SplinePatchScores(patch.part, patch.patch, patch.size, base, controls, rms, largest, of_patch, seconds)


def true_splines(file: Path, points: int = POINTS) -> Iterator[TrueSpline]:
    """The B-spline patches of a part, each sampled uniformly by area; the same sample every time."""
    packed = file.suffix == ".npz"
    part = load_part(file)
    exact = None if packed else _Exact.of(file)
    free = np.unique(part.patch[(part.type == BSPLINE) & (part.patch >= 0)])
    for number in free.tolist():
        rng = np.random.default_rng(number)
        mine = np.flatnonzero(part.patch[part.face] == number)
        count = points + _PROBES
        if exact is None:
            some = replace(part, triangles=part.triangles[mine], face=part.face[mine])
            cloud = some.sample(rng, count, 0)
            places, normals = cloud.points.astype(np.float64), cloud.normals.astype(np.float64)
        else:
            places, normals = exact.sample(part, mine, count, rng)
        size = float(np.ptp(places, axis=0).max())
        yield TrueSpline(file.stem, number, size, places[:points], normals[:points], places[points:])


@dataclass(frozen=True)
class _Exact:
    """The faces of a CAD file, tessellated as its LabelledPart is."""

    faces: Sequence[object]
    uv: Array  # (n, 2) of the nodes
    frame: Frame

    @classmethod
    def of(cls, file: Path) -> _Exact:
        shape = read_shape(file)
        faces = faces_of(shape)
        mesh = mesh_of(shape, faces)
        return cls(faces, mesh.uv, mesh.frame)

    def sample(
        self, part: LabelledPart, triangles: NDArray[np.int64], count: int, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Exact points (count, 3) and unit normals over some of the part's triangles, uniform by flat area."""
        corners = part.nodes[part.triangles[triangles]].astype(np.float64)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        pick = rng.choice(triangles, count, p=area / area.sum())
        uv = np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), count), self.uv[part.triangles[pick]])
        points, normals = np.empty((count, 3)), np.empty((count, 3))
        for face in np.unique(part.face[pick]):
            mine = part.face[pick] == face
            points[mine], normals[mine] = evaluate(self.faces[face], uv[mine])
            normals[mine] *= _way(normals[mine], part, pick[mine])
        good = np.einsum("ij,ij->i", normals, normals) > 0.25  # not at a pole
        return self.frame.apply(points), np.where(good[:, None], normals, normals[good][:1])


def _way(normals: Array, part: LabelledPart, triangles: NDArray[np.int64]) -> float:
    """-1 where the surface's own normals (n, 3) point into the part, by the triangles (n,), else 1."""
    corners = part.nodes[part.triangles[triangles]].astype(np.float64)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return -1.0 if np.einsum("ij,ij->", normals, outward) < 0 else 1.0


def _shape(primitive: Primitive) -> tuple[str, int]:
    """What a freeform surface stands on, and its number of control points or heights."""
    if isinstance(primitive, NetSurface):
        return ("closed net" if primitive.closed else "open net"), primitive.net.size // 3
    assert isinstance(primitive, BSplineSurface)
    return primitive.base, primitive.heights.size


def spline_patches_text(rows: Sequence[SplinePatchScores]) -> str:
    """A summary by size and base, and the worst patches."""
    if not rows:
        return "no B-spline patches"
    return "\n".join([*aligned(_summary(rows)), "", *aligned(_worst(rows))])


def _summary(rows: Sequence[SplinePatchScores]) -> list[list[str]]:
    header = ["spline patches", "patches", "rms / size, median", "95 %", f"<= {CLOSE:g}", "of its own", "s", "s, worst"]
    table = [header]
    groups = [("all", list(rows))]
    groups += [(base, [row for row in rows if row.base == base]) for base in sorted({row.base for row in rows})]
    for name, some in groups:
        rms = np.array([row.rms for row in some])
        seconds = np.array([row.seconds for row in some])
        figures = [f"{np.median(rms):.1e}", f"{np.quantile(rms, 0.95, method='higher'):.1e}", _percent(rms)]
        figures += [_percent(row.rms_of_patch for row in some), f"{seconds.mean():.2f}", f"{seconds.max():.2f}"]
        table.append([name, str(len(some)), *figures])
    return table


def _worst(rows: Sequence[SplinePatchScores]) -> list[list[str]]:
    table = [["worst patches", "patch", "size", "base", "controls", "rms / size", "largest", "rms / its own"]]
    for row in sorted(rows, key=lambda row: -row.rms)[:_WORST]:
        place = [row.part, str(row.patch), f"{row.size:.3f}", row.base, str(row.controls)]
        table.append([*place, f"{row.rms:.1e}", f"{row.largest:.1e}", f"{row.rms_of_patch:.1e}"])
    return table


def _percent(values: Iterable[float]) -> str:
    return f"{100 * float(np.mean(np.fromiter(values, float) <= CLOSE)):.1f} %"
