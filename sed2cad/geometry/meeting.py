"""Whether two surfaces cross or touch along a chain."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.chains import onto_both
from sed2cad.geometry.contact import Meeting, Side, angles, relative_curvature
from sed2cad.geometry.curves import Array

_SHALLOW = np.radians(15.0)  # wider angles between the normals always cross
_LEVEL = np.radians(3.0)  # narrower ones never cross
_REACH = 0.04  # unit frame: how far sideways the place where the normals agree may lie
_GAP = 2e-4  # unit frame: surfaces that touch come this near to each other, give or take the fit
_PROBES = 12  # chain points that are tried both ways


def meeting(a: Side, b: Side, points: Array) -> Meeting:
    """How a and b meet along the chain points (n, 3).

    Tangent surfaces have a place near by where their normals agree and the surfaces meet; a plane and a draft
    face of 5 degrees do not, nor does a plane that cuts a shallow slice off a cylinder.
    """
    if a.primitive is b.primitive:
        return "resting"
    trim = len(points) // 6 if len(points) > 8 else 0
    middle = points[trim : len(points) - trim]
    angle = float(np.median(angles(a, b, middle)))
    if angle > _SHALLOW:
        return "crossing"
    if a.free or b.free:
        return "resting"
    curvature = float(np.median(relative_curvature(a, b, middle).curvature))
    if angle > _REACH * curvature:
        return "crossing" if angle > _LEVEL else "resting"
    return "crossing" if angle > _LEVEL and _cuts(a, b, middle) else "touching"


def _cuts(a: Side, b: Side, points: Array) -> bool:
    """Whether the surfaces part where their normals agree, but cross right at the chain points (n, 3)."""
    probes = points[np.linspace(0, len(points) - 1, min(len(points), _PROBES)).astype(int)]
    touching, crossing = onto_both(a, b, probes, "touching"), onto_both(a, b, probes, "crossing")
    nearer = np.median(crossing.moved) < 0.25 * np.median(touching.moved)
    return bool(nearer and np.median(touching.residual) > _GAP)
