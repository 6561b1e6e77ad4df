"""Faces that their surface cannot close: a ring around a torus or a cylinder with nothing on its other side.

Where no cap was missed, the surface is the wrong one: a dome that was taken for a piece of a torus, or was given a
B-spline about an axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sed2cad.fitting import fit
from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.bspline_fit import fit_over_plane
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.revolution import Revolution
from sed2cad.primitives.vectors import root_mean_square
from sed2cad.scan.scan import Scan
from sed2cad.topology.caps import Round, turns
from sed2cad.topology.model import Region, Topology

_WORSE = 2.0  # times the rms of the wrong surface that a sphere may have
_FINEST = 1e-4  # unit frame: rms that is always good enough


def closable(scan: Scan, topology: Topology, fitted: Sequence[FittedPatch]) -> list[FittedPatch]:
    """The patches, those under faces that cannot close refitted as a sphere or, at worst, a B-spline."""
    patches = list(fitted)
    for number in sorted({face.primitive for face in topology.regions if _is_open(face, topology, fitted)}):
        patches[number] = _domed(scan, fitted[number])
    return patches


def _is_open(face: Region, topology: Topology, fitted: Sequence[FittedPatch]) -> bool:
    """Whether the loops of a face go around its axis without coming back, and no apex lies inside."""
    patch = fitted[face.primitive]
    primitive = patch.primitive
    if not face.loops or not isinstance(primitive, Round):
        return False
    if isinstance(primitive, BSplineSurface) and primitive.base == "plane":
        return False
    around = turns(primitive, face, topology.chains)
    has_apex = isinstance(primitive, Cone) and around * patch.sign < 0
    if isinstance(primitive, Revolution):
        has_apex = primitive.poles()[int(around * patch.sign > 0)]
    return abs(around) > 0.5 and not has_apex


def _domed(scan: Scan, patch: FittedPatch) -> FittedPatch:
    points, normals = scan.points[patch.patch.indices], scan.normals[patch.patch.indices]
    for kind in ("sphere", "bspline"):
        found = fit(kind, points, normals, scan.noise) if len(points) > 6 else None
        if found is None:
            continue
        primitive, rms, covariance = found
        if _goes_round(primitive):
            flat = fit_over_plane(points, normals, scan.noise)
            if flat is None:
                continue
            primitive, rms = flat, root_mean_square(flat.distance(points))
        if kind == "sphere" and rms > max(_WORSE * patch.rms, _FINEST):
            continue
        sign = primitive.side(points, normals)
        return FittedPatch(replace(patch.patch, kind=kind), primitive, sign, rms, covariance)
    return patch


def _goes_round(primitive: Primitive) -> bool:
    """Whether a freeform surface closes on itself like a cylinder."""
    if isinstance(primitive, NetSurface):
        return primitive.closed
    return isinstance(primitive, BSplineSurface) and primitive.base != "plane"
