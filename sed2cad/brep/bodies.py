"""Several bodies: separate solids, and cavities as inner shells of the solid around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.TopAbs import TopAbs_IN
from OCP.TopoDS import TopoDS_Shape, TopoDS_Solid

from sed2cad.brep.kernel import compound, faces, shells, solids, vertices, volume
from sed2cad.geometry.layout import Layout, LayoutFace
from sed2cad.geometry.polygons import Cloud


@dataclass(frozen=True)
class BodyShape:
    """A repaired body, its faces looking outwards as if it were a solid of its own."""

    shape: TopoDS_Shape
    regions: tuple[int, ...]  # of each face, in order
    cavity: bool  # the material is outside
    is_open: bool = False  # a shell, no solid


@dataclass(frozen=True)
class Joined:
    """All bodies as one shape."""

    shape: TopoDS_Shape
    regions: tuple[int, ...]  # of each face, in order
    solids: int  # how many there should be
    is_open: bool = False  # whether shells are among them


def cavities(layout: Layout, areas: Sequence[float], clouds: Mapping[int, Cloud]) -> dict[int, bool]:
    """For each body whether it is a cavity: its volume, from points and normals of its faces, is negative.

    `areas` are those of the regions; faces without a surface have a cloud, by region.
    """
    volumes: dict[int, float] = {}
    for body in sorted({face.body for face in layout.faces}):
        own = [face for face in layout.faces if face.body == body]
        centre = np.vstack([face.points for face in own]).mean(axis=0)
        volumes[body] = sum(_flux(face, centre, clouds) * areas[face.region] for face in own)
    return {body: flux < 0 and body not in layout.open_bodies for body, flux in volumes.items()}


def _flux(face: LayoutFace, centre: np.ndarray, clouds: Mapping[int, Cloud]) -> float:
    """Mean of (p - centre) . outward normal over a face."""
    points, normals = face.points, face.sign * face.primitive.normal(face.points)
    if face.region in clouds:
        points, normals = clouds[face.region].points, clouds[face.region].normals
    return float(np.einsum("ij,ij->i", points - centre, normals).mean())


def join(bodies: Sequence[BodyShape]) -> Joined:
    """Put every cavity into the smallest solid around it; the rest side by side."""
    outer = [body for body in bodies if not body.cavity]
    inside: dict[int, list[BodyShape]] = {k: [] for k in range(len(outer))}
    strays = []
    for body in bodies:
        if body.cavity:
            around = [k for k, other in enumerate(outer) if _contains(other.shape, body.shape)]
            if around:
                inside[min(around, key=lambda k: volume(outer[k].shape))].append(body)
            else:
                strays.append(body)
    parts = [_hollowed(body, inside[k]) for k, body in enumerate(outer)] + [(b.shape, b.regions) for b in strays]
    regions = tuple(region for _, own in parts for region in own)
    open_ = sum(body.is_open for body in outer)
    return Joined(compound([shape for shape, _ in parts]), regions, len(outer) - open_, open_ > 0)


def _contains(solid: TopoDS_Shape, other: TopoDS_Shape) -> bool:
    """Whether a solid contains the other shape (told by one vertex)."""
    corners = vertices(other)
    if not corners or not solids(solid):
        return False
    test = BRepClass3d_SolidClassifier(solid, BRep_Tool.Pnt_s(corners[0]), 1e-7)
    return bool(test.State() == TopAbs_IN)


def _hollowed(body: BodyShape, holes: Sequence[BodyShape]) -> tuple[TopoDS_Shape, tuple[int, ...]]:
    """The solid with the shells of its cavities, and the regions of its faces."""
    if not holes:
        return body.shape, body.regions
    builder, solid = BRep_Builder(), TopoDS_Solid()
    builder.MakeSolid(solid)
    for shell in shells(body.shape):
        builder.Add(solid, shell)
    regions = list(body.regions)
    for hole in holes:
        for shell in shells(hole.shape):
            builder.Add(solid, shell.Reversed())
        regions += hole.regions
    assert len(regions) == len(faces(solid))
    return solid, tuple(regions)
