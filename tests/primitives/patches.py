"""Synthetic patches: points and outward normals on a part of a known primitive, in a random pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame

Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Sample:
    truth: Primitive
    points: Array  # (n, 3)
    normals: Array  # (n, 3)


def random_rotation(rng: np.random.Generator) -> Array:
    """Uniform rotation (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def rotated(primitive: Primitive, turn: Array, shift: Array) -> Primitive:
    """The primitive under p -> turn p + shift."""
    if isinstance(primitive, Plane):
        normal = turn @ primitive.normal_vector
        return Plane(normal, primitive.offset + float(normal @ shift))
    if isinstance(primitive, Cylinder):
        return Cylinder(turn @ primitive.axis, turn @ primitive.point + shift, primitive.radius)
    if isinstance(primitive, Cone):
        apex = turn @ primitive.apex + shift
        return Cone(turn @ primitive.axis, apex, primitive.half_angle, primitive.reach)
    if isinstance(primitive, Sphere):
        return Sphere(turn @ primitive.centre + shift, primitive.radius)
    assert isinstance(primitive, Torus)
    centre = turn @ primitive.centre + shift
    return Torus(turn @ primitive.axis, centre, primitive.major_radius, primitive.minor_radius)


def plane_patch(rng: np.random.Generator, n: int, width: float = 0.3, length: float = 0.4) -> Sample:
    flat = rng.uniform(-0.5, 0.5, (n, 2)) * [length, width]
    return Sample(Plane(Z, 0.0), np.column_stack([flat, np.zeros(n)]), np.tile(Z, (n, 1)))


def cylinder_patch(
    rng: np.random.Generator, n: int, radius: float = 0.1, height: float = 0.3, arc: float = 360.0
) -> Sample:
    angle, z = _angles(rng, n, arc), rng.uniform(-0.5, 0.5, n) * height
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    return Sample(Cylinder(Z, np.zeros(3), radius), radius * radial + z[:, None] * Z, radial)


def cone_patch(
    rng: np.random.Generator,
    n: int,
    half_angle: float = 30.0,
    low: float = 0.1,
    high: float = 0.3,
    arc: float = 360.0,
) -> Sample:
    """Between two distances from the apex along the surface."""
    alpha, angle = np.radians(half_angle), _angles(rng, n, arc)
    along = np.sqrt(rng.uniform(low**2, high**2, n))
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    points = along[:, None] * (np.sin(alpha) * radial + np.cos(alpha) * Z)
    return Sample(Cone(Z, np.zeros(3), float(alpha)), points, np.cos(alpha) * radial - np.sin(alpha) * Z)


def sphere_patch(rng: np.random.Generator, n: int, radius: float = 0.2, cap: float = 180.0) -> Sample:
    """The part within `cap` degrees of the pole."""
    cosine = rng.uniform(np.cos(np.radians(cap)), 1, n)
    angle, sine = _angles(rng, n, 360), np.sqrt(1 - cosine**2)
    normals = np.column_stack([sine * np.cos(angle), sine * np.sin(angle), cosine])
    return Sample(Sphere(np.zeros(3), radius), radius * normals, normals)


def torus_patch(
    rng: np.random.Generator,
    n: int,
    major: float = 0.2,
    minor: float = 0.05,
    arc: float = 360.0,
    tube: tuple[float, float] = (0.0, 360.0),
) -> Sample:
    """`arc` degrees around the axis, `tube` degrees around the tube (0 is outermost, 90 on top)."""
    angle, around = _angles(rng, n, arc), np.radians(rng.uniform(*tube, n))
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    normals = np.cos(around)[:, None] * radial + np.sin(around)[:, None] * Z
    return Sample(Torus(Z, np.zeros(3), major, minor), major * radial + minor * normals, normals)


def disturbed(sample: Sample, rng: np.random.Generator, noise: float, normal_noise: float = 0.0) -> Sample:
    """Moved to a random pose, points off along the normal by `noise`, normals off by so many degrees."""
    turn, shift = random_rotation(rng), rng.uniform(-0.3, 0.3, 3)
    points, normals = sample.points @ turn.T + shift, sample.normals @ turn.T
    points = points + normals * rng.normal(size=(len(points), 1)) * noise
    normals = normals + rng.normal(size=normals.shape) * np.radians(normal_noise)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Sample(rotated(sample.truth, turn, shift), points, normals)


def axis_angle(a: Array, b: Array) -> float:
    """Angle between two undirected axes, degrees."""
    return float(np.degrees(np.arcsin(np.clip(np.linalg.norm(np.cross(a, b)), 0, 1))))


def line_distance(point: Array, axis: Array, origin: Array) -> float:
    """Distance of a point from a line."""
    x, y = tangent_frame(axis)
    return float(np.hypot((point - origin) @ x, (point - origin) @ y))


def _angles(rng: np.random.Generator, n: int, arc: float) -> Array:
    return np.radians(rng.uniform(-arc / 2, arc / 2, n))
