"""From the points of a patch to the primitive that explains them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sed2cad.brep.beside import run_each
from sed2cad.network.predict_net import predicted_starts
from sed2cad.primitives.base import Array, FittedPatch, Patch, Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.bspline_fit import fit_bspline
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.freeform_fit import fit_freeform
from sed2cad.primitives.oriented_fit import directions, normal_noise, oriented_fit, points_know_better
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.refine import is_degenerate, tukey_weights, uncertainty
from sed2cad.primitives.registry import ANALYTIC_KINDS, KINDS, primitive_class
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.robust_fit import FINEST, START_POINTS, explains, misfits, robust_fit, thinned
from sed2cad.primitives.simplest import analytic_instead
from sed2cad.primitives.swept_choice import Explained, swept_instead
from sed2cad.primitives.tensor_patch import TensorPatch
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Scan
from sed2cad.tying import tied

_MOST_SPLINE_POINTS = 5000  # enough for the most knots
_INDEPENDENT = 50  # points of a patch that err independently, as far as parameters are concerned
_LEAST_INTERIOR = 0.1  # of a patch: less of a narrow one may all lie in one place
_STRAY = 9.0  # chi^2 of a point that does not belong
_SIMPLER: Mapping[str, Sequence[str]] = {
    "cylinder": ("plane",),
    "sphere": ("plane",),
    "cone": ("plane", "cylinder"),
    "torus": ("plane", "cylinder", "sphere", "cone"),
}
_LARGEST_RADIUS = 20.0  # part diagonals; rounder is flat

# Shares of the faces of real parts; torus and freeform must earn their place.
FACE_SHARES: Mapping[str, float] = {
    "plane": 0.60,
    "cylinder": 0.27,
    "cone": 0.045,
    "sphere": 0.0003,  # 0.006, but a narrow ring of one is nearly always a chamfer, a cone
    "torus": 0.005,  # 0.02, but the freest of all imitates any other
    "bspline": 0.01,
}


@dataclass(frozen=True)
class FittedPrimitive:
    """A primitive, how well it fits and what it costs to believe in it."""

    primitive: Primitive
    rms: float  # of all distances
    covariance: Array  # (freedom, freedom) in the primitive's chart
    cost: float  # -2 log posterior up to a constant; comparable for the same points only


def fit(
    kind: str, points: Array, normals: Array, noise: float, angle: float = math.inf
) -> tuple[Primitive, float, Array] | None:
    """Robust least squares on orthogonal distances: primitive, rms, covariance (freedom, freedom).

    points and unit normals (n, 3), noise in their unit (0 when unknown). Where the deviation of the normals is known
    (`angle`, radians), their angles count too. None where all this does not determine such a primitive.
    """
    known = 3 if math.isfinite(angle) else 1  # numbers that a point tells
    if known * len(points) < 3 or (kind == "bspline" and len(points) < 6):
        return None
    if kind == "bspline":
        surface = fit_freeform(*thinned(points, normals, _MOST_SPLINE_POINTS), noise, predicted_starts)
        return None if surface is None else _measured(surface, points, points, noise)
    found = robust_fit(kind, points, normals, noise) if len(points) >= 3 else None
    oriented = oriented_fit(kind, found and found[0], points, normals, noise, angle)
    if oriented is None:
        return None
    if found is not None and oriented is found[0]:
        return _measured(oriented, points, found[1], noise)
    told = uncertainty(oriented, points, noise, directions(oriented, points, normals, noise, angle))
    covariance = told.covariance * max(noise / told.sigma, 1.0) ** 2  # so few points tell little of the noise
    return oriented, root_mean_square(oriented.distance(points)), covariance


def select(
    points: Array,
    normals: Array,
    noise: float,
    kinds: Sequence[str] = KINDS,
    log_prior: Mapping[str, float] | None = None,
) -> FittedPrimitive | None:
    """The kind with the least chi^2 + parameters * log n - 2 log prior (Schwarz 1978), fitted.

    chi^2 counts distances and normals in units of the noise, or of the best fit where that is above it.
    A primitive that is another, simpler one in disguise is not considered, nor a B-spline where anything
    analytic reaches the noise.
    """
    few = thinned(points, normals, START_POINTS)
    found = _analytic_fits(*few, noise, [kind for kind in ANALYTIC_KINDS if kind in kinds])
    scale = max(noise, FINEST)
    if "bspline" in kinds and not any(explains(entry.primitive, few[0], scale) for entry in found):
        surface = fit_bspline(*few, noise)
        found += [] if surface is None else [_Candidate(surface, _robust_sigma(surface, few[0], noise))]
    if not found:
        return None
    prior = {kind: np.log(share) for kind, share in FACE_SHARES.items()} if log_prior is None else log_prior
    sigma = max(scale, min(entry.sigma for entry in found))
    costs = _costs([entry.primitive for entry in found], *few, sigma)
    costs -= 2 * np.array([prior.get(entry.primitive.kind, 0.0) for entry in found])
    best = int(np.argmin(costs))
    chosen = found[best].primitive
    more = len(points) > len(few[0]) and chosen.kind != "bspline"
    final = fit(chosen.kind, points, normals, noise) if more else None
    primitive, rms, covariance = final or _measured(chosen, points, points, noise)
    return FittedPrimitive(primitive, rms, covariance, float(costs[best]))


def _measured(primitive: Primitive, points: Array, used: Array, noise: float) -> tuple[Primitive, float, Array]:
    """The primitive with its rms over the points (n, 3) and its covariance from the used ones (m, 3)."""
    covariance = uncertainty(primitive, used, noise).covariance
    return primitive, root_mean_square(primitive.distance(points)), covariance


def fit_patches(scan: Scan, patches: Sequence[Patch]) -> list[FittedPatch]:
    """Every patch with its primitive, in order (paper, eq. 7: without edge points, except for B-splines).

    Where the patch's kind cannot be fitted, another one is chosen; at worst a plane. A freeform patch that a profile
    sweeps becomes an extrusion or a surface of revolution; one of too few points is tied to an axis beside it.
    """
    fitted = run_each(_fit_patch, [_Case.of(scan, patch) for patch in patches])
    angle = angle_noise(scan, fitted)
    if math.isinf(angle) and scan.noise > FINEST:
        return [_simplified(f, _Case.of(scan, f.patch)) for f in fitted]
    asking = [k for k, f in enumerate(fitted) if _asks_normals(scan, f.patch, angle)]
    for k, again in zip(asking, run_each(_fit_patch, [_Case.of(scan, fitted[k].patch, angle) for k in asking])):
        fitted[k] = again
    return tied(scan, fitted, angle)


@dataclass(frozen=True)
class _Case:
    """A patch and what its fit looks at."""

    patch: Patch
    points: Array  # (n, 3)
    normals: Array  # (n, 3)
    noise: float
    angle: float  # deviation of the normals, radians; infinite where it is not known

    @classmethod
    def of(cls, scan: Scan, patch: Patch, angle: float = math.inf) -> _Case:
        used = used_points(patch)
        return cls(patch, scan.points[used], scan.normals[used], scan.noise, angle)


def _simplified(fitted: FittedPatch, case: _Case) -> FittedPatch:
    """The patch on the simplest surface that its points do not tell from its own (Schwarz 1978).

    Normals estimated from noisy points bend towards the borders of a patch, so that narrow planes look round.
    """
    points, normals = case.points, case.normals
    noise = max(case.noise, FINEST)
    for kind in _SIMPLER.get(fitted.primitive.kind, ()):
        found = fit(kind, points, normals, case.noise, case.angle)
        if found is None:
            continue
        saved = _chi_square(found[0], case, noise) - _chi_square(fitted.primitive, case, noise)
        if saved < (fitted.primitive.freedom - found[0].freedom) * np.log(min(len(points), _INDEPENDENT)):
            patch = replace(fitted.patch, kind=kind)
            return FittedPatch(patch, found[0], found[0].side(points, normals), *found[1:])
    return fitted


def _chi_square(primitive: Primitive, case: _Case, noise: float) -> float:
    """Of the distances and, where their deviation is known, of the normals' angles, what does not belong capped."""
    off = np.minimum((primitive.distance(case.points) / noise) ** 2, _STRAY)
    turned = np.minimum((primitive.angles(case.points, case.normals) / case.angle) ** 2, _STRAY)
    return float(off.sum() + turned.sum())


def _asks_normals(scan: Scan, patch: Patch, angle: float) -> bool:
    """Whether a fit by the points alone leaves something to be told."""
    points = scan.points[used_points(patch)]
    return patch.kind in ANALYTIC_KINDS and not points_know_better(points, scan.noise, angle)


def angle_noise(scan: Scan, fitted: Sequence[FittedPatch]) -> float:
    """Deviation of the scan's normals, radians; infinite where no patch tells it."""
    sure = [(patch.primitive, used_points(patch.patch)) for patch in fitted]
    primitives, used = [primitive for primitive, _ in sure], [indices for _, indices in sure]
    return normal_noise(primitives, [scan.points[own] for own in used], [scan.normals[own] for own in used])


def used_points(patch: Patch) -> NDArray[np.int64]:
    """Indices of the points that a fit of this patch looks at: the interior, where there is enough of it."""
    kind = patch.kind if patch.kind in KINDS else "bspline"
    enough = max(12, 3 * primitive_class(kind).freedom, _LEAST_INTERIOR * len(patch.indices))
    return patch.indices[patch.interior] if kind != "bspline" and patch.interior.sum() >= enough else patch.indices


def _fit_patch(case: _Case) -> FittedPatch:
    patch, points, normals, noise = case.patch, case.points, case.normals, case.noise
    found = fit(patch.kind, points, normals, noise, case.angle) if patch.kind in KINDS else None
    if found is None:
        chosen = select(points, normals, noise) if len(points) >= 3 else None
        found = (chosen.primitive, chosen.rms, chosen.covariance) if chosen else _any_plane(points, normals)
        if chosen and chosen.primitive.kind == "bspline":  # the choice was a quick one
            found = fit("bspline", points, normals, noise) or found
    primitive, rms, covariance = found
    for simpler in (swept_instead_of, analytic_instead_of) if primitive.freeform else ():
        instead = simpler(primitive, points, normals, noise)
        if instead is not None:
            primitive, covariance = instead
            rms = root_mean_square(primitive.distance(points))
    fitted = FittedPatch(patch, primitive, primitive.side(points, normals), rms, covariance)
    noisy = math.isfinite(case.angle) and noise > FINEST
    return _simplified(fitted, case) if noisy or is_degenerate(primitive, points, FINEST) else fitted


def swept_instead_of(
    primitive: Primitive, points: Array, normals: Array, noise: float
) -> tuple[Primitive, Array] | None:
    """A swept surface, or a simpler one, in place of a freeform one, and its covariance."""
    return swept_instead([Explained(primitive, parameter_count(primitive), points, normals)], noise)


def analytic_instead_of(
    primitive: Primitive, points: Array, normals: Array, noise: float
) -> tuple[Primitive, Array] | None:
    """An analytic surface in place of a freeform or swept one, and its covariance."""
    return analytic_instead(points, normals, noise, primitive, parameter_count(primitive))


def _any_plane(points: Array, normals: Array) -> tuple[Primitive, float, Array]:
    """A plane through one or two points."""
    normal = normals[0]
    plane = Plane(normal, float(normal @ points.mean(axis=0)))
    return plane, root_mean_square(plane.distance(points)), np.eye(3)


@dataclass(frozen=True)
class _Candidate:
    primitive: Primitive
    sigma: float  # robust standard deviation of the distances


def _analytic_fits(points: Array, normals: Array, noise: float, kinds: Sequence[str]) -> list[_Candidate]:
    """Fits worth comparing, without those that are freer than one that leaves nothing to explain."""
    found: list[_Candidate] = []
    tolerance = max(noise, FINEST)
    for kind in kinds:
        freedom = primitive_class(kind).freedom
        if any(entry.sigma < 0.9 * tolerance and entry.primitive.freedom <= freedom for entry in found):
            continue
        fitted = fit(kind, points, normals, noise)
        if fitted is None or _radius(fitted[0]) > _LARGEST_RADIUS:
            continue
        primitive = fitted[0]
        if kind != "plane" and len(kinds) > 1 and is_degenerate(primitive, points, tolerance):
            continue
        found.append(_Candidate(primitive, _robust_sigma(primitive, points, noise)))
    return found


def _costs(primitives: Sequence[Primitive], points: Array, normals: Array, sigma: float) -> Array:
    """chi^2 + parameters * log n of each primitive (k,); beyond 400 points errors are systematic."""
    points, normals = thinned(points, normals, 400)
    parameters = np.array([_parameter_count(primitive) for primitive in primitives])
    weight = np.log(min(len(points), _INDEPENDENT))
    return np.asarray(misfits(primitives, points, normals, sigma) + parameters * weight)


def _parameter_count(primitive: Primitive) -> int:
    """Numbers that the points had to determine; smoothing ties about half of a spline's."""
    return parameter_count(primitive) // 2 if isinstance(primitive, BSplineSurface) else primitive.freedom


def parameter_count(primitive: Primitive) -> int:
    """Numbers that shape and place a surface."""
    if isinstance(primitive, TensorPatch):
        return primitive.shape_numbers
    profile = primitive.profile.numbers if isinstance(primitive, Extrusion | Revolution) else 0
    return primitive.freedom + profile


def _radius(primitive: Primitive) -> float:
    """The largest radius among the parameters, 0 for none."""
    lengths = (getattr(primitive, name, 0.0) for name in ("radius", "major_radius", "minor_radius"))
    return float(max(lengths))


def _robust_sigma(primitive: Primitive, points: Array, noise: float) -> float:
    """Weighted standard deviation of the distances."""
    residual = primitive.distance(points)
    weights = tukey_weights(residual, noise, primitive.freedom)
    return float(np.sqrt(weights @ residual**2 / max(float(weights.sum()) - primitive.freedom, 1.0)))
