"""Fit surfaces that a profile sweeps: along a direction, or about an axis.

The pose comes from the normals (across the direction; through the axis: Pottmann and Randrup 1998, Rotational and
helical surface approximation for reverse engineering), the profile from the points seen in that pose; then pose and
profile are solved for together, by Gauss-Newton on the distances, while knots are added where the profile is stiff.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array
from sed2cad.primitives.extrusion import Extrusion
from sed2cad.primitives.profile import Profile
from sed2cad.primitives.profile_fit import MOST_SPANS, Course, Sight, bent, blank, course, cut, stiff_spans
from sed2cad.primitives.refine import median_size, tukey_weights, usual_size
from sed2cad.primitives.revolution import Revolution, reaching
from sed2cad.primitives.starts import revolution_axes
from sed2cad.primitives.vectors import tangent_frame, unit

Swept = Extrusion | Revolution

FEWEST = 30  # points
_MOST_POINTS = 3000
_FINEST = 2e-5  # unit frame: residuals that nobody needs to explain
_SPANS = 3  # to begin with
_ROUNDS = 9  # of knots
_HOPELESS = 5.0  # sigma: a median residual above this,
_GAIN = 0.7  # times that of the round before, will not come down by more knots: the surface is not swept
_TURNS = 3  # Gauss-Newton steps for each
_LONGEST_TILT = 0.1  # radians, in one step
_MARGIN = 0.03  # of the profile's length, that it goes on beyond the points,
_SPACINGS = 2.0  # but no more than so many times their distance from each other
_TO_AXIS = 0.06  # of that length: an end of a profile that is this near to the axis reaches it
_REWEIGHTED = 4
_CAUCHY = 2.385  # 95 % efficiency on Gaussian noise
_ANGLE = 0.3  # radians: an error of normals that counts as much as the noise; they err in groups


@dataclass(frozen=True)
class SweptFit:
    """A swept surface and how well it is known."""

    surface: Swept
    covariance: Array  # (freedom, freedom) of its direction or axis, the profile being unknown
    numbers: int  # that the points determined


def fit_extrusion(points: Array, normals: Array, noise: float = 0.0) -> SweptFit | None:
    """The extrusion through points (n, 3) with unit normals (n, 3), or None where they are along no such surface."""
    if len(points) < FEWEST:
        return None
    direction = _across_all(normals)
    x = tangent_frame(direction)[0]
    return _fitted(Extrusion(direction, points.mean(axis=0), x, _NOTHING), points, normals, noise)


def fit_revolution(points: Array, normals: Array, noise: float = 0.0) -> SweptFit | None:
    """The surface of revolution through points (n, 3) with unit normals (n, 3), or None where there is none."""
    if len(points) < FEWEST:
        return None
    try:
        with np.errstate(all="ignore"):
            axis, point = revolution_axes(points, normals)[0]
    except np.linalg.LinAlgError:  # coinciding points
        return None
    origin = point + float((points.mean(axis=0) - point) @ axis) * axis
    return _fitted(Revolution(axis, origin, _NOTHING), points, normals, noise)


_NOTHING = Profile(np.arange(8.0), np.zeros((4, 2)), False)


def _across_all(normals: Array) -> Array:
    """The direction (3,) most nearly across the normals (n, 3), whatever a few of them say."""
    weights = np.ones(len(normals))
    direction = np.zeros(3)
    for _ in range(_REWEIGHTED):
        direction = np.linalg.eigh((normals * weights[:, None]).T @ normals)[1][:, 0]
        weights = tukey_weights(normals @ direction, 0.01, 2)
    return np.asarray(direction)


def _seen(surface: Swept, points: Array, normals: Array) -> tuple[Array, Array]:
    """Points and normals (n, 3) in the plane of the profile: both (n, 2), these unit."""
    if isinstance(surface, Extrusion):
        return surface.flat(points), unit(normals @ surface.axes.T)
    flat = surface.meridian(points)
    offset = points - surface.origin
    radial = offset - (offset @ surface.axis)[:, None] * surface.axis
    outwards = np.einsum("ij,ij->i", normals, radial) / np.maximum(flat[:, 0], 1e-12)
    return flat, unit(np.column_stack([outwards, normals @ surface.axis]))


def _fitted(start: Swept, points: Array, normals: Array, noise: float) -> SweptFit | None:
    """Pose and profile from a first pose."""
    step = max(1, -(-len(points) // _MOST_POINTS))
    points, normals = points[::step], normals[::step]
    flat, arrows = _seen(start, points, normals)
    try:
        way = course(flat, arrows, noise)
        if way is None:
            return None
        return _Fitting.begun(start, points, normals, way, noise).refined()
    except np.linalg.LinAlgError:
        return None


@dataclass
class _Fitting:
    """A fit under way."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3)
    noise: float
    surface: Swept
    along: Array  # (n,): parameters of the points on the profile
    residual: Array  # (n,)
    covariance: Array

    @classmethod
    def begun(cls, start: Swept, points: Array, normals: Array, way: Course, noise: float) -> _Fitting:
        """With the profile across the normals of the points, before it has its own."""
        flat, arrows = _seen(start, points, normals)
        blanks = blank(way, min(_SPANS + 3 * way.closed, max(1, len(points) // 12)))
        sight = Sight(flat, arrows, np.zeros((len(points), 0)), np.ones(len(points)))
        first = bent(blanks, way.along, arrows, sight, max(noise, _FINEST) / _ANGLE).profile
        residual, covariance = np.zeros(len(points)), np.zeros((start.freedom, start.freedom))
        fitting = cls(points, normals, noise, replace(start, profile=first), way.along, residual, covariance)
        fitting.look()
        return fitting

    def look(self) -> None:
        """Find the points' parameters, beyond the ends by how far they are beyond them, and residuals."""
        surface = self.surface
        flat = surface.flat(self.points) if isinstance(surface, Extrusion) else surface.meridian(self.points)
        profile = surface.profile
        self.along = profile.foot(flat)
        self.residual = profile.gap(flat, self.along)[2]
        if not profile.closed:
            over = np.einsum("ij,ij->i", flat - profile.at(self.along), profile.tangent(self.along))
            beyond = np.isin(self.along, profile.ends)
            self.along[beyond] += over[beyond]

    @property
    def sigma(self) -> float:
        """What the points err by, at least."""
        return max(self.noise, _FINEST)

    def weights(self, final: bool) -> Array:
        """Biweights (n,) in the end; before that Cauchy's, which leave no point out for which knots may be missing."""
        if final:
            return tukey_weights(self.residual, self.sigma, self.surface.profile.numbers)
        scale = _CAUCHY * max(self.sigma, usual_size(self.residual))
        return np.asarray(1 / (1 + (self.residual / scale) ** 2))

    def refined(self) -> SweptFit | None:
        """Knots and poses until nothing but noise is left."""
        self.improve()
        before = np.inf
        for _ in range(_ROUNDS):
            usual = median_size(self.residual)
            if usual > max(_HOPELESS * self.sigma, _GAIN * before):
                break
            before = usual
            stiff = stiff_spans(self.surface.profile, self.along, self.residual, self.sigma)
            if not stiff.any() or stiff.sum() + len(stiff) > MOST_SPANS:
                break
            self.improve(cut(self.surface.profile, stiff))
        self.improve(final=True)
        if not np.isfinite(self.residual).all():
            return None
        numbers = self.surface.profile.numbers + self.surface.freedom
        weights = self.weights(True)
        variance = float(weights @ self.residual**2) / max(float(weights.sum()) - numbers, 1.0)
        return SweptFit(self.finished(), variance * self.covariance, numbers)

    def improve(self, profile: Profile | None = None, final: bool = False) -> None:
        """A few Gauss-Newton steps on the knots of a profile (its own)."""
        for _ in range(_TURNS):
            surface = self.surface
            flat, arrows = _seen(surface, self.points, self.normals)
            sight = Sight(flat, arrows, surface.jacobian(self.points), self.weights(final))
            across = _right_of(surface.profile.tangent(self.along))
            knots = surface.profile if profile is None else profile
            if not knots.closed:
                low, high = float(self.along.min()), float(self.along.max())
                if not high > low:
                    raise np.linalg.LinAlgError("the points tell of one place of the profile only")
                knots = knots.between(low, high)
            found = bent(knots, self.along, across, sight, self.sigma / _ANGLE)
            delta = found.delta.copy()
            delta *= min(1.0, _LONGEST_TILT / max(float(np.abs(delta[:2]).max()), 1e-300))
            self.surface = replace(surface, profile=found.profile).moved(delta)
            self.covariance = found.covariance
            self.look()
            profile = None

    def finished(self) -> Swept:
        """The surface, its profile going on a little beyond the points, or to the axis where that is near."""
        profile = self.surface.profile
        if profile.closed:
            return self.surface
        low, high = profile.ends
        spacing = float(np.median(cKDTree(self.points).query(self.points, 2)[0][:, 1]))
        margin = min(_MARGIN * (high - low), _SPACINGS * spacing)
        if isinstance(self.surface, Revolution):
            grown = reaching(profile, margin, round=True, snap=_TO_AXIS * (high - low))
        else:
            grown = profile.longer(margin, margin, round=True)
        return replace(self.surface, profile=grown)


def _right_of(tangents: Array) -> Array:
    """Vectors (n, 2) turned right."""
    return np.column_stack([tangents[:, 1], -tangents[:, 0]])
