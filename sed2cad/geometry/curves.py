"""The curves that edges run on: line, circle, ellipse, and the interpolated rest.

A curve is immutable and in the unit of its points. Its parameter is a length (line, interpolated) or an angle
in radians (circle, ellipse; period 2 pi).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

Array = NDArray[np.float64]
TURN = 2 * np.pi
_SURELY = 0.7  # times the distance from the points of the shorter arc: the longer one is no farther


class Curve(ABC):
    """A curve with a parameter."""

    kind: ClassVar[str]  # "line", "circle", "ellipse", "interpolated"
    angular: ClassVar[bool] = False  # whether the parameter is an angle

    @abstractmethod
    def at(self, parameters: Array) -> Array:
        """Points (n, 3) at parameters (n,)."""

    @abstractmethod
    def parameters(self, points: Array) -> Array:
        """Parameters (n,) of the points of the curve nearest to points (n, 3); angles in (-pi, pi]."""

    @abstractmethod
    def reversed(self) -> Self:
        """The same curve run the other way."""

    @abstractmethod
    def scaled(self, scale: float, origin: Array) -> Self:
        """The curve under p -> scale * p + origin; parameters that are lengths grow by `scale`."""

    def distance(self, points: Array) -> Array:
        """Distances (n,) of points (n, 3)."""
        return np.asarray(np.linalg.norm(points - self.at(self.parameters(points)), axis=1))


@dataclass(frozen=True, eq=False)
class Line(Curve):
    """origin + t * direction."""

    kind: ClassVar[str] = "line"

    origin: Array  # (3,)
    direction: Array  # (3,), unit

    def at(self, parameters: Array) -> Array:
        return self.origin + parameters[:, None] * self.direction

    def parameters(self, points: Array) -> Array:
        return (points - self.origin) @ self.direction

    def reversed(self) -> Line:
        return Line(self.origin, -self.direction)

    def scaled(self, scale: float, origin: Array) -> Line:
        return Line(scale * self.origin + origin, self.direction)


@dataclass(frozen=True, eq=False)
class Circle(Curve):
    """centre + radius (cos t x + sin t y), y = axis x x."""

    kind: ClassVar[str] = "circle"
    angular: ClassVar[bool] = True

    centre: Array  # (3,)
    axis: Array  # (3,), unit
    x: Array  # (3,), unit, across the axis
    radius: float

    @property
    def y(self) -> Array:
        return np.cross(self.axis, self.x)

    def at(self, parameters: Array) -> Array:
        way = np.outer(np.cos(parameters), self.x) + np.outer(np.sin(parameters), self.y)
        return self.centre + self.radius * way

    def parameters(self, points: Array) -> Array:
        offset = points - self.centre
        return np.arctan2(offset @ self.y, offset @ self.x)

    def reversed(self) -> Circle:
        return replace(self, axis=-self.axis)

    def started_at(self, angle: float) -> Circle:
        """The circle turned so that its parameter 0 is at `angle`."""
        return replace(self, x=np.cos(angle) * self.x + np.sin(angle) * self.y)

    def scaled(self, scale: float, origin: Array) -> Circle:
        return Circle(scale * self.centre + origin, self.axis, self.x, scale * self.radius)


@dataclass(frozen=True, eq=False)
class Ellipse(Curve):
    """centre + major cos t x + minor sin t y, y = axis x x; major >= minor."""

    kind: ClassVar[str] = "ellipse"
    angular: ClassVar[bool] = True

    centre: Array  # (3,)
    axis: Array  # (3,), unit
    x: Array  # (3,), unit, along the major axis
    major: float
    minor: float

    @property
    def y(self) -> Array:
        return np.cross(self.axis, self.x)

    def at(self, parameters: Array) -> Array:
        cos, sin = np.cos(parameters), np.sin(parameters)
        return self.centre + self.major * np.outer(cos, self.x) + self.minor * np.outer(sin, self.y)

    def parameters(self, points: Array) -> Array:
        """Nearest points by Newton steps on the angle, from the best of 32."""
        offset = points - self.centre
        p, q = offset @ self.x, offset @ self.y
        a, b = self.major, self.minor
        tried = np.linspace(0, TURN, 32, endpoint=False)
        off = (p[:, None] - a * np.cos(tried)) ** 2 + (q[:, None] - b * np.sin(tried)) ** 2
        angle = tried[off.argmin(axis=1)]
        for _ in range(6):
            cos, sin = np.cos(angle), np.sin(angle)
            slope = (a * a - b * b) * sin * cos - p * a * sin + q * b * cos
            curvature = (a * a - b * b) * (cos * cos - sin * sin) - p * a * cos - q * b * sin
            angle = angle - np.clip(slope / np.minimum(curvature, -1e-3 * b * b), -0.3, 0.3)
        return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))

    def reversed(self) -> Ellipse:
        return replace(self, axis=-self.axis)

    def scaled(self, scale: float, origin: Array) -> Ellipse:
        return Ellipse(scale * self.centre + origin, self.axis, self.x, scale * self.major, scale * self.minor)


@dataclass(frozen=True, eq=False)
class Interpolated(Curve):
    """The cubic spline through points, run by their chord length from 0; C2 around when closed."""

    kind: ClassVar[str] = "interpolated"

    points: Array  # (k, 3), k >= 2; a closed curve does not repeat its first point
    closed: bool

    @cached_property
    def knots(self) -> Array:
        """The parameter of each point (k,), and of the end when closed (k + 1,)."""
        points = np.vstack([self.points, self.points[:1]]) if self.closed else self.points
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-12))])

    @cached_property
    def spline(self) -> BSpline:
        """The curve as a clamped B-spline (closed curves meet in position, slope and curvature)."""
        if not self.closed:
            return make_interp_spline(self.knots, self.points, k=min(3, len(self.points) - 1))
        points = np.vstack([self.points, self.points[:1]])
        slope = CubicSpline(self.knots, points, bc_type="periodic")(0.0, 1)
        return make_interp_spline(self.knots, points, k=3, bc_type=([(1, slope)], [(1, slope)]))

    @property
    def length(self) -> float:
        """The last parameter."""
        return float(self.knots[-1])

    def at(self, parameters: Array) -> Array:
        wrapped = np.mod(parameters, self.length) if self.closed else parameters
        return np.asarray(self.spline(wrapped))

    def parameters(self, points: Array) -> Array:
        """Nearest of a fine sampling, then Gauss-Newton steps."""
        fine = np.unique(np.concatenate([np.linspace(a, b, 9) for a, b in zip(self.knots, self.knots[1:])]))
        gap = np.linalg.norm(self.at(fine)[None] - points[:, None], axis=2)
        found = fine[gap.argmin(axis=1)]
        for _ in range(8):
            tangent = np.asarray(self.spline(found, 1))
            step = np.einsum("ij,ij->i", points - self.spline(found), tangent)
            found = found + step / np.maximum(np.einsum("ij,ij->i", tangent, tangent), 1e-300)
            found = np.clip(found, 0.0, self.length)
        return found

    def reversed(self) -> Interpolated:
        return Interpolated(self.points[::-1].copy(), self.closed)

    def scaled(self, scale: float, origin: Array) -> Interpolated:
        return Interpolated(scale * self.points + origin, self.closed)


@dataclass(frozen=True, eq=False)
class Arc:
    """A piece of a curve, run from `first` to `last` (first < last)."""

    curve: Curve
    first: float
    last: float

    def sampled(self, count: int) -> Array:
        """Points (count, 3) at even parameters, both ends included."""
        return self.curve.at(np.linspace(self.first, self.last, count))

    def ends(self) -> tuple[Array, Array]:
        """First and last point (3,)."""
        points = self.sampled(2)
        return points[0], points[1]

    def scaled(self, scale: float, origin: Array) -> Arc:
        """The arc under p -> scale * p + origin."""
        grow = 1.0 if self.curve.angular else scale
        return Arc(self.curve.scaled(scale, origin), grow * self.first, grow * self.last)


def arc_through(curve: Curve, points: Array, closed: bool) -> Arc:
    """The arc of `curve` along ordered points (k, 3), from the first to the last, turned to run their way.

    A closed arc makes one full turn from the first point.
    """
    if isinstance(curve, Interpolated):
        return Arc(curve, 0.0, curve.length)
    sweep = _sweep(curve, points, closed) if curve.angular else float(np.ptp(curve.parameters(points[[0, -1]])))
    if _runs_back(curve, points, sweep):
        curve, sweep = curve.reversed(), abs(sweep)
    first = float(curve.parameters(points[:1])[0])
    least = 1e-9 if curve.angular else 1e-9 * max(1.0, float(np.abs(points).max()))
    first = first % TURN if curve.angular else first
    return Arc(curve, first, first + max(sweep, least))


def winding(angles: Array) -> int:
    """Turns of a closed polygon of angles (n,) whose last repeats the first."""
    steps = np.mod(np.diff(angles) + np.pi, TURN) - np.pi
    return round(float(steps.sum()) / TURN)


def _runs_back(curve: Curve, points: Array, sweep: float) -> bool:
    """Whether the points go against the curve's parameter."""
    if curve.angular:
        return sweep < 0
    first, last = curve.parameters(points[[0, -1]])
    return bool(last < first)


def _sweep(curve: Curve, points: Array, closed: bool) -> float:
    """The signed angle that ordered points (k, 3) run along a circle or ellipse.

    First and last point leave a choice of whole turns; the arc whose points lie along the given ones wins, the longer
    way around only if they surely do: a short chain across a fillet says little. Closed points that go around the
    curve's axis say it themselves, however far they stray.
    """
    angles = curve.parameters(points)
    if closed and (turns := winding(np.append(angles, angles[:1]))):
        return float(np.sign(turns)) * TURN
    first, last = angles[[0, -1]]
    apart = np.mod(last - first + np.pi, TURN) - np.pi
    choices = np.array([-TURN, TURN]) if closed else apart + TURN * np.array([0.0, -1.0, 1.0])
    choices = choices[np.abs(choices) < TURN + 1e-6]
    share = np.linspace(0.0, 1.0, len(points), endpoint=not closed)
    off = np.array([np.linalg.norm(curve.at(first + share * choice) - points, axis=1).mean() for choice in choices])
    off[np.abs(choices) > np.abs(choices).min() + 1e-6] /= _SURELY
    return float(choices[int(off.argmin())])
