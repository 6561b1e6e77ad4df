"""Whether two surfaces cross or touch along a chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sed2cad.geometry.chains import onto_both
from sed2cad.geometry.contact import (
    LEVEL,
    REACH,
    Meeting,
    Side,
    angle_along,
    middle,
    relative_curvature,
    touches,
)
from sed2cad.geometry.curves import Array
from sed2cad.topology.model import Chain, Topology

_FLAT = 1.0  # 1 / unit: surfaces that part more slowly than this do not say where they touch
_GAP = 2e-4  # unit frame: surfaces that touch come this near to each other, give or take the fit
_PROBES = 12  # chain points that are tried both ways
_STEEP = np.radians(45.0)  # a short chain is not that far astray
_NEARER = 0.1  # share: tangent surfaces are this much nearer to each other than ones that cross at the angle seen


def meeting(a: Side, b: Side, points: Array) -> Meeting:
    """How a and b meet along the chain points (n, 3).

    Tangent surfaces meet where their normals agree; a plane that cuts a shallow slice off a cylinder does
    not.
    """
    if a.loose or b.loose:
        return "resting"
    if not touches(a, b, points):
        return "touching" if _strayed(a, b, points) else "crossing"
    if a.primitive is b.primitive or a.free or b.free:
        return "resting"
    if np.median(relative_curvature(a, b, middle(points)).curvature) < _FLAT:
        return "resting"
    return "crossing" if angle_along(a, b, points) > LEVEL and _cuts(a, b, middle(points)) else "touching"


def meetings_of(topology: Topology, sides: Sequence[Side]) -> list[Meeting]:
    """How the surfaces of each chain meet."""
    return [meeting(*sides_of(topology, sides, chain), chain.points) for chain in topology.chains]


def sides_of(topology: Topology, sides: Sequence[Side], chain: Chain) -> tuple[Side, Side]:
    """The surfaces left and right of a chain."""
    return sides[topology.regions[chain.left].primitive], sides[topology.regions[chain.right].primitive]


def _cuts(a: Side, b: Side, points: Array) -> bool:
    """Whether the surfaces part where their normals agree, but cross right at the chain points (n, 3)."""
    probes = points[np.linspace(0, len(points) - 1, min(len(points), _PROBES)).astype(int)]
    touching, crossing = onto_both(a, b, probes, "touching"), onto_both(a, b, probes, "crossing")
    nearer = np.median(crossing.moved) < 0.25 * np.median(touching.moved)
    return bool(nearer and np.median(touching.residual) > _GAP)


def _strayed(a: Side, b: Side, points: Array) -> bool:
    """Whether tangent surfaces seem to cross only because the chain points (n, 3) wander off where they touch.

    Surfaces that cross at an angle t are t^2 / (2 k) apart where their normals agree, k their relative curvature.
    """
    if a.free or b.free or not LEVEL < (angle := angle_along(a, b, points)) < _STEEP:
        return False
    curvature = float(np.median(relative_curvature(a, b, middle(points)).curvature))
    if angle > REACH * curvature:
        return False
    gap = float(np.median(onto_both(a, b, middle(points), "touching").residual))
    return gap < min(_GAP, _NEARER * angle**2 / (2 * curvature))
