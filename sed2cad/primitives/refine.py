"""Orthogonal distance regression: Gauss-Newton with Marquardt's damping in the chart of a primitive."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.starts import is_proper
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame, tilted, unit

_TUKEY = 4.685  # 95 % efficiency on Gaussian noise
_LEAST_SCALE = 1e-7  # unit frame; keeps the weights finite on exact points
_DIFFERENCE = 1e-6  # of the chart: the error of central differences is its square over that of a radius


@dataclass(frozen=True)
class Directions:
    """Measured normals that have a say in the place of a primitive beside the points."""

    normals: Array  # (n, 3), unit, all on the side that the primitive's normals point to
    angle: float  # deviation of their components across the true normal, radians
    noise: float  # deviation of the points, above 0

    def whitening(self, primitive: Primitive, points: Array) -> Array:
        """Matrices (n, 3, 3) that make the errors of the gaps independent and as large as the noise.

        A point that is off sideways asks for the normal of another place, which says little where the radius is not
        well above the noise. So the covariance of a gap is angle^2 + noise^2 S S^T with S = d normal / d point.
        """
        steps = self.noise * np.eye(3)
        slopes = [primitive.normal(points + step) - primitive.normal(points - step) for step in steps]
        shift = np.stack(slopes, axis=2) / 2
        covariance = self.angle**2 * np.eye(3) + shift @ shift.transpose(0, 2, 1)
        return np.asarray(self.noise * np.linalg.inv(np.linalg.cholesky(covariance)))

    def gaps(self, primitive: Primitive, points: Array, whitening: Array) -> Array:
        """Primitive's normals at the points minus the measured ones, whitened (n, 3): in units of length."""
        return np.einsum("nij,nj->ni", whitening, primitive.normal(points) - self.normals)

    def trust(self, gaps: Array, freedom: int) -> Array:
        """Weights (n,), without those that belong elsewhere."""
        return tukey_weights(np.linalg.norm(gaps, axis=1), self.noise, freedom)

    def terms(self, primitive: Primitive, points: Array) -> _Turns:
        """Linearised around a primitive."""
        whitening = self.whitening(primitive, points)
        gaps = self.gaps(primitive, points, whitening)
        turning = whitening @ normal_jacobian(primitive, points)
        return _Turns(whitening, gaps, self.trust(gaps, primitive.freedom), turning)


@dataclass(frozen=True)
class _Turns:
    """Directions, linearised."""

    whitening: Array  # (n, 3, 3)
    gaps: Array  # (n, 3)
    trust: Array  # (n,)
    turning: Array  # (n, 3, freedom), d gaps / d delta

    @property
    def cost(self) -> float:
        return float(self.trust @ (self.gaps**2).sum(axis=1))

    @property
    def gradient(self) -> Array:
        return np.asarray(np.einsum("n,ni,nik->k", self.trust, self.gaps, self.turning))

    @property
    def hessian(self) -> Array:
        return np.asarray(np.einsum("n,nik,nil->kl", self.trust, self.turning, self.turning))


def refine(
    primitive: Primitive,
    points: Array,
    noise: float,
    steps: int,
    robust: bool = True,
    directions: Directions | None = None,
) -> Primitive:
    """The primitive moved downhill on the (Tukey-weighted) squares of its distances to points (n, 3).

    With directions, on those of its normals' angles to them too. It rests where the next step promises less than a
    thousandth of one point's share of the cost.
    """
    primitive = centred(primitive, points)
    state, middle = _linearised(primitive, points, noise, robust, directions), points.mean(axis=0)
    damping = 1e-6
    for _ in range(steps):
        step, promised = state.step(damping)
        if promised <= 1e-3 / len(points) * state.cost:
            break
        trial = bent(primitive, step, middle) if isinstance(primitive, Torus) else primitive.moved(step)
        if is_proper(trial) and state.cost_of(trial, points) <= state.cost:
            primitive, damping = trial, damping / 10
            state = _linearised(primitive, points, noise, robust, directions)
        else:
            damping = max(damping, 1e-5) * 30
            if damping > 1e4:
                break
    return primitive


def bent(torus: Torus, step: Array, middle: Array) -> Torus:
    """The torus moved by a step of its chart, to first order, along the valley of a short arc near `middle` (3,).

    There the centre is far from the points and hangs on the tilts, the shift and the major radius all at once: what
    is nearly linear is the place of the tube amid the points and its curvature. So these two take the step.
    """
    offset, major = middle - torus.centre, torus.major_radius
    across = offset - (offset @ torus.axis) * torus.axis
    reach = float(np.linalg.norm(across))
    if reach < 0.5 * major:  # the points surround the axis
        return torus.moved(step)
    outwards, axis = across / reach, tilted(torus.axis, step[:2])
    x, y = tangent_frame(torus.axis)
    sinking = major * float((step[0] * x + step[1] * y) @ outwards)
    tube = torus.centre + step[2:5] + (major + step[5]) * outwards - sinking * torus.axis
    major /= 1 - min(float(step[5]) / major, 0.9)
    centre = tube - major * unit(outwards - (outwards @ axis) * axis)
    return Torus(axis, centre, major, torus.minor_radius + float(step[6]))


@dataclass(frozen=True)
class _Linearised:
    """The weighted squares around one primitive: cost + 2 gradient . delta + delta . hessian . delta."""

    weights: Array  # (n,)
    cost: float
    gradient: Array  # (freedom,)
    hessian: Array  # (freedom, freedom)
    directions: Directions | None
    turns: _Turns | None

    def step(self, damping: float) -> tuple[Array, float]:
        """Marquardt's step, independent of the units of the chart, and the fall of the cost it promises."""
        scale = 1 / np.sqrt(np.maximum(np.diag(self.hessian), 1e-30))
        system = self.hessian * scale[:, None] * scale + (damping + 1e-12) * np.eye(len(scale))
        step = -scale * np.linalg.solve(system, scale * self.gradient)
        return step, float(-(2 * self.gradient + self.hessian @ step) @ step)

    def cost_of(self, primitive: Primitive, points: Array) -> float:
        """Cost of another primitive with the same weights."""
        cost = float(self.weights @ primitive.distance(points) ** 2)
        if self.directions is None or self.turns is None:
            return cost
        gaps = self.directions.gaps(primitive, points, self.turns.whitening)
        return cost + float(self.turns.trust @ (gaps**2).sum(axis=1))


def _linearised(
    primitive: Primitive, points: Array, noise: float, robust: bool, directions: Directions | None
) -> _Linearised:
    residual, jacobian = primitive.distance(points), primitive.jacobian(points)
    weights = tukey_weights(residual, noise, primitive.freedom) if robust else np.ones(len(points))
    weighted = jacobian * weights[:, None]
    cost, gradient, hessian = float(weights @ residual**2), residual @ weighted, weighted.T @ jacobian
    if directions is None:
        return _Linearised(weights, cost, gradient, hessian, None, None)
    turns = directions.terms(primitive, points)
    return _Linearised(
        weights, cost + turns.cost, gradient + turns.gradient, hessian + turns.hessian, directions, turns
    )


def normal_jacobian(primitive: Primitive, points: Array) -> Array:
    """d normal / d delta at points (n, 3): (n, 3, freedom), by central differences in the chart."""
    steps = _DIFFERENCE * np.eye(primitive.freedom)
    slopes = [primitive.moved(step).normal(points) - primitive.moved(-step).normal(points) for step in steps]
    return np.stack(slopes, axis=2) / (2 * _DIFFERENCE)


def tukey_weights(residual: Array, noise: float, freedom: int) -> Array:
    """Biweights (n,) of residuals (n,), in units of the noise or of their own median where that is larger."""
    return np.asarray((1 - _squares(residual, noise, freedom)) ** 2)


def tukey_weights_and_slopes(residual: Array, noise: float, freedom: int) -> tuple[Array, Array]:
    """Biweights w (n,) of residuals r (n,), and the derivatives (n,) of w r by r."""
    square = _squares(residual, noise, freedom)
    return (1 - square) ** 2, (1 - square) * (1 - 5 * square)


def _squares(residual: Array, noise: float, freedom: int) -> Array:
    """Squares (n,) of the residuals in units of the distance at which the weight ends, at most 1."""
    spare = max(len(residual) - freedom, 1) / len(residual)  # few points hug the surface: widen the scale
    scale = max(noise, usual_size(residual) / np.sqrt(spare), _LEAST_SCALE)
    return np.asarray(np.minimum((residual / (_TUKEY * scale)) ** 2, 1))


def median_size(residual: Array) -> float:
    """The median of |residual| (n,); a tenth of the time of numpy's."""
    middle = len(residual) // 2
    return float(np.partition(np.abs(residual), middle)[middle])


def usual_size(residual: Array) -> float:
    """Standard deviation of residuals (n,) if most of them are normal: 1.4826 times the median of their sizes."""
    return 1.4826 * median_size(residual)


def centred(primitive: Primitive, points: Array) -> Primitive:
    """The same surface with the pivot of its chart amid the points (n, 3)."""
    if isinstance(primitive, Cylinder):
        slide = float((points.mean(axis=0) - primitive.point) @ primitive.axis)
        return replace(primitive, point=primitive.point + slide * primitive.axis)
    if isinstance(primitive, Cone):
        return replace(primitive, reach=float((points.mean(axis=0) - primitive.apex) @ primitive.axis))
    return primitive


@dataclass(frozen=True)
class Uncertainty:
    """How well points determine a primitive."""

    sigma: float  # standard deviation of the points along the normal, without outliers
    covariance: Array  # (freedom, freedom) in the primitive's chart


def uncertainty(
    primitive: Primitive, points: Array, noise: float, directions: Directions | None = None
) -> Uncertainty:
    """Covariance of the M-estimate (Huber 1981, chapter 7.6); huge along what points and directions leave open.

    With psi(r) = w(r) r it is sum(psi^2) / sum(psi')^2 times the inverse of the mean of J^T J over the points that
    count. The weights shrink the residuals that they let through, so sum(w r^2) / sum(w) is less than sigma^2; for
    Gaussian noise E[psi r] = sigma^2 E[psi'] (Stein), which gives sigma without that bias.
    """
    residual, jacobian = primitive.distance(points), primitive.jacobian(points)
    weights, slopes = tukey_weights_and_slopes(residual, noise, primitive.freedom)
    total = float(weights.sum())
    spare = max(1 - primitive.freedom / max(total, 1.0), 1 / max(total, 1.0))
    slope = max(float(slopes.sum()), 0.3 * total)  # less only where the residuals are anything but Gaussian
    least = _LEAST_SCALE**2
    variance = max(float(weights @ residual**2) / (slope * spare), least)
    factor = max(float(weights**2 @ residual**2) * total / (slope**2 * spare), least)
    hessian = (jacobian * weights[:, None]).T @ jacobian
    if directions is not None:
        hessian = hessian + directions.terms(primitive, points).hessian
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-30))
    values, vectors = np.linalg.eigh(hessian * scale[:, None] * scale)
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    return Uncertainty(float(np.sqrt(variance)), factor * inverse * scale[:, None] * scale)


def is_degenerate(primitive: Primitive, points: Array, tolerance: float) -> bool:
    """True where a simpler kind is the same surface over the points (n, 3), to within the tolerance.

    So are a cone of constant radius (a cylinder), a torus without a hole (a sphere) and any round surface
    without sagitta (a plane).
    """
    if isinstance(primitive, Cone):
        height = (points - primitive.apex) @ primitive.axis
        if np.ptp(height) * np.tan(primitive.half_angle) < tolerance:
            return True
    if isinstance(primitive, Torus) and primitive.major_radius < 4 * tolerance + 0.02 * primitive.minor_radius:
        return True
    feet = primitive.project(points)
    middle = feet.mean(axis=0)
    return bool(np.ptp((feet - middle) @ primitive.normal(middle[None])[0]) < tolerance)
