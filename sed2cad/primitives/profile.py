"""Planar cubic B-spline curves: what is swept along a direction or turned about an axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

from sed2cad.primitives.base import Array

DEGREE = 3
_PER_SPAN = 8  # samples of a knot span, from the nearest of which the search for a foot point starts
_FOOT_STEPS = 12
_STILL = 1e-9  # of the samples' distance: a foot point that moves less has been found


@dataclass(frozen=True, eq=False)
class Profile:
    """C(t) in a plane. The normal is the tangent turned right: (tangent_y, -tangent_x).

    An open profile is bounded by its clamped knots: beyond its ends the distance is that to the end, with the sign
    of the side. The knots of a closed one go on beyond its period, and the last three controls repeat the first.
    """

    knots: Array  # (n + 4,), lengths
    controls: Array  # (n, 2), lengths
    closed: bool

    @cached_property
    def _curves(self) -> tuple[BSpline, BSpline, BSpline]:
        """The curve and its first two derivatives."""
        curve = BSpline(self.knots, self.controls, DEGREE)
        return curve, curve.derivative(1), curve.derivative(2)

    @property
    def ends(self) -> tuple[float, float]:
        """First and last parameter."""
        return float(self.knots[DEGREE]), float(self.knots[-DEGREE - 1])

    @property
    def numbers(self) -> int:
        """How many numbers shape the curve: one for each control point, across the curve."""
        return len(self.controls) - (DEGREE if self.closed else 0)

    def at(self, t: Array) -> Array:
        """Points (n, 2) at parameters (n,)."""
        return np.asarray(self._curves[0](self.wrapped(t)))

    def tangent(self, t: Array) -> Array:
        """Unit tangents (n, 2) at parameters (n,)."""
        slope = self._curves[1](self.wrapped(t))
        return np.asarray(slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300))

    def bend(self, t: Array) -> Array:
        """Signed curvature (n,) at parameters (n,), positive where the curve turns left."""
        at = self.wrapped(t)
        slope, change = self._curves[1](at), self._curves[2](at)
        speed = np.maximum(np.linalg.norm(slope, axis=1), 1e-300)
        return np.asarray((slope[:, 0] * change[:, 1] - slope[:, 1] * change[:, 0]) / speed**3)

    def wrapped(self, t: Array) -> Array:
        """Parameters (n,) brought into the domain."""
        low, high = self.ends
        return np.asarray(low + np.mod(t - low, high - low) if self.closed else np.clip(t, low, high))

    @cached_property
    def _nearby(self) -> tuple[Array, cKDTree]:
        """Parameters (m,) all along the curve and their points, for look-up."""
        inner = np.unique(self.knots[DEGREE:-DEGREE])
        share = np.arange(_PER_SPAN) / _PER_SPAN
        t = np.append((inner[:-1, None] + np.diff(inner)[:, None] * share).ravel(), inner[-1])
        return t, cKDTree(self.at(t))

    def foot(self, points: Array) -> Array:
        """Parameters (n,) of the nearest points of the curve to points (n, 2): Newton from the nearest sample."""
        samples, tree = self._nearby
        nearest = tree.query(points)[1]
        t = samples[nearest]
        step = np.diff(samples).max()
        low, high = (t - step, t + step) if self.closed else (np.maximum(t - step, samples[0]), t + step)
        high = high if self.closed else np.minimum(high, samples[-1])
        curve, first, second = self._curves
        moving = np.arange(len(t))
        for _ in range(_FOOT_STEPS):
            at = self.wrapped(t[moving])
            gap, slope, change = points[moving] - curve(at), first(at), second(at)
            square = np.maximum(np.einsum("ij,ij->i", slope, slope), 1e-300)
            bent = square - np.einsum("ij,ij->i", gap, change)
            move = np.einsum("ij,ij->i", gap, slope) / np.where(bent > 0.2 * square, bent, square)
            new = np.clip(t[moving] + move, low[moving], high[moving])
            far = np.abs(new - t[moving]) > _STILL * step
            t[moving] = new
            moving = moving[far]
            if not len(moving):
                break
        return self.wrapped(t)

    def gap(self, points: Array, t: Array | None = None) -> tuple[Array, Array, Array]:
        """Foot points (n, 2), normals there (n, 2) and signed distances (n,) of points (n, 2); t (n,) of the feet."""
        t = self.foot(points) if t is None else t
        feet, tangent = self.at(t), self.tangent(t)
        normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
        offset = points - feet
        side = np.einsum("ij,ij->i", offset, normal)
        return feet, normal, np.copysign(np.linalg.norm(offset, axis=1), side)

    def scaled(self, scale: float) -> Self:
        """The curve under p -> scale * p."""
        return type(self)(scale * self.knots, scale * self.controls, self.closed)

    def between(self, low: float, high: float) -> Self:
        """The curve with its knots moved and stretched to begin and end at these parameters."""
        first, last = self.ends
        knots = low + (self.knots - first) * ((high - low) / (last - first))
        return type(self)(knots, self.controls, self.closed)

    def longer(self, start: float, end: float, round: bool = False) -> Self:
        """An open curve that goes on by these lengths beyond its ends: straight, or round as it is there."""
        grown = self if end <= 0 else self._longer(end, round)
        return grown if start <= 0 else grown.reversed()._longer(start, round).reversed()

    def reversed(self) -> Self:
        """The same curve the other way."""
        low, high = self.ends
        return type(self)((low + high - self.knots)[::-1].copy(), self.controls[::-1].copy(), self.closed)

    def _longer(self, reach: float, round: bool) -> Self:
        """One more span at the end, a cubic with the slope of the curve there (and of the circle where round)."""
        high = np.array([self.ends[1]])
        (start,), (way,), turn = self.at(high), self.tangent(high), float(self.bend(high)[0]) * reach
        turn = float(np.clip(turn, -0.5, 0.5)) if round else 0.0
        left = np.array([-way[1], way[0]])
        sine, cosine = np.sinc(turn / np.pi), (1 - np.cos(turn)) / turn if abs(turn) > 1e-6 else turn / 2
        end = start + reach * (sine * way + cosine * left)
        after = np.cos(turn) * way + np.sin(turn) * left
        speed = float(np.linalg.norm(self._curves[1](high)[0]))
        span = reach / max(speed, 1e-300)
        added = [start + reach / 3 * way, end - reach / 3 * after, end]
        knots = np.concatenate([self.knots[:-2], [high[0] + span] * (DEGREE + 1)])
        return type(self)(knots, np.vstack([self.controls[:-1], added]), False)

    def parameters(self) -> dict[str, Any]:
        """Knots, and control points as pairs; those of a closed profile are not repeated."""
        shown = self.controls[:-DEGREE] if self.closed else self.controls
        return {
            "profile": tuple((float(a), float(b)) for a, b in shown),
            "knots": tuple(map(float, self.knots)),
            "closed": bool(self.closed),
        }

    @classmethod
    def from_parameters(cls, parameters: dict[str, Any]) -> Self:
        """Inverse of `parameters`. ValueError where a number is missing or they make no curve."""
        try:
            controls = np.array(parameters["profile"], float)
            knots = np.array(parameters["knots"], float)
            closed = bool(parameters["closed"])
        except (KeyError, TypeError, ValueError):
            raise ValueError("The profile of a swept surface is missing or not made of numbers.") from None
        finite = np.isfinite(controls).all() and np.isfinite(knots).all()
        if controls.ndim != 2 or controls.shape[1] != 2 or not finite:
            raise ValueError("The profile of a swept surface must be pairs of finite numbers.")
        if closed:
            controls = np.vstack([controls, controls[:DEGREE]])
        if len(controls) < DEGREE + 1 or knots.shape != (len(controls) + 4,) or (np.diff(knots) < 0).any():
            raise ValueError("The knots and the profile of a swept surface do not fit together.")
        return cls(knots, controls, closed)
