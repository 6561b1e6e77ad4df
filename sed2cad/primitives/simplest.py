"""Whether a freeform patch is an analytic surface after all, as far as anyone can see."""

from __future__ import annotations

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.refine import uncertainty, usual_size
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.robust_fit import UNSEEN, robust_fit, thinned

_MOST_POINTS = 2000  # to fit and to judge by
_INDEPENDENT = 100  # points that err independently
_FARTHEST = 3.5  # deviations of a point that belongs
_MOST = 2.0  # rms in units of what nobody sees, however many numbers it saves
_ELSEWHERE = 0.05  # share of the points that may belong elsewhere
_TURNED = 0.15  # radians: mean angle of the normals, at most


def analytic_instead(
    points: Array, normals: Array, noise: float, surface: Primitive, numbers: int
) -> tuple[Primitive, Array] | None:
    """An analytic surface that explains points (n, 3) and normals (n, 3) as well as a freeform one; its covariance.

    Schwarz' criterion (1978) for an unknown variance, to which what nobody sees is added: n log(rms^2 + unseen^2)
    + k log n. The surface so far has `numbers` that shape it. None where it is better.
    """
    points, normals = thinned(points, normals, _MOST_POINTS)
    unseen = max(noise, UNSEEN)
    least, best = _cost(surface, points, numbers, unseen), None
    for kind in ANALYTIC_KINDS:
        found = robust_fit(kind, points, normals, noise)
        if found is None or float(found[0].angles(points, normals).mean()) > _TURNED:
            continue
        cost = _cost(found[0], points, found[0].freedom, unseen)
        if cost < least and _explains(found[0], points, unseen):
            least, best = cost, found[0]
    return None if best is None else (best, uncertainty(best, points, noise).covariance)


def _cost(surface: Primitive, points: Array, numbers: int, unseen: float) -> float:
    count = min(len(points), _INDEPENDENT)
    return float(count * np.log(_robust_rms(surface, points, unseen) ** 2 + unseen**2) + numbers * np.log(count))


def _explains(surface: Primitive, points: Array, unseen: float) -> bool:
    """Whether what is left is hardly to be seen, and nowhere but at points that may belong elsewhere."""
    off = float(np.quantile(np.abs(surface.distance(points)), 1 - _ELSEWHERE))
    return off < _FARTHEST * unseen and _robust_rms(surface, points, unseen) < _MOST * unseen


def _robust_rms(surface: Primitive, points: Array, unseen: float) -> float:
    """Of the distances, each counted up to what belongs."""
    residual = np.abs(surface.distance(points))
    most = _FARTHEST * max(usual_size(residual), unseen)
    return float(np.sqrt(np.mean(np.minimum(residual, most) ** 2)))
