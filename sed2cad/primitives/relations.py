"""Exact relations between primitives, as equations in the few numbers that place them.

Every primitive is described by eight numbers, its placement: direction (3), position (3) and two sizes. All
equations work on whole stacks of placements and are analytic, so that a complex step differentiates them to
the last digit (Squire and Trapp 1998, Using complex variables to estimate derivatives).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sed2cad.primitives.base import Array, Primitive
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus
from sed2cad.primitives.vectors import tangent_frame

Stack = NDArray[Any]  # (n,) or (n, k), real, or complex for the derivative
PLACEMENT = 8


@dataclass(frozen=True)
class Placed:
    """A stack of placements (n, 8) with names."""

    numbers: Stack

    @property
    def direction(self) -> Stack:
        """Normal of a plane, axis of the others, zero for a sphere: (n, 3)."""
        return self.numbers[:, 0:3]

    @property
    def position(self) -> Stack:
        """Centre, or for a cylinder or cone a point of the axis: (n, 3)."""
        return self.numbers[:, 3:6]

    @property
    def size(self) -> Stack:
        """Offset of a plane, radius of a cylinder or sphere, half angle of a cone, major radius (n,)."""
        return self.numbers[:, 6]

    @property
    def second(self) -> Stack:
        """Minor radius of a torus, radius of a cone at its position (n,)."""
        return self.numbers[:, 7]

    @property
    def apex(self) -> Stack:
        """Apex of a cone (n, 3)."""
        return self.position - (self.second / np.tan(self.size))[:, None] * self.direction


def placement(primitive: Primitive) -> Array:
    """The eight numbers of an analytic primitive."""
    zero = np.zeros(3)
    if isinstance(primitive, Plane):
        return np.array([*primitive.normal_vector, *zero, primitive.offset, 0.0])
    if isinstance(primitive, Cylinder):
        return np.array([*primitive.axis, *primitive.point, primitive.radius, 0.0])
    if isinstance(primitive, Cone):
        pivot, radius = (
            primitive.apex + primitive.reach * primitive.axis,
            primitive.reach * np.tan(primitive.half_angle),
        )
        return np.array([*primitive.axis, *pivot, primitive.half_angle, radius])
    if isinstance(primitive, Sphere):
        return np.array([*zero, *primitive.centre, primitive.radius, 0.0])
    if isinstance(primitive, Torus):
        return np.array([*primitive.axis, *primitive.centre, primitive.major_radius, primitive.minor_radius])
    raise ValueError(f"A {primitive.kind} has no placement.")


def placement_jacobian(primitive: Primitive) -> Array:
    """d placement / d delta in the primitive's chart: (8, freedom)."""
    jacobian = np.zeros((PLACEMENT, primitive.freedom))
    if isinstance(primitive, Sphere):
        jacobian[3:7] = np.eye(4)
        return jacobian
    across = np.column_stack(tangent_frame(placement(primitive)[:3]))
    jacobian[0:3, 0:2] = across
    if isinstance(primitive, Plane):
        jacobian[6, 2] = 1
    elif isinstance(primitive, Torus):
        jacobian[3:8, 2:7] = np.eye(5)
    else:
        jacobian[3:6, 2:4] = across
        jacobian[6 if isinstance(primitive, Cylinder) else 7, 4] = 1
        if isinstance(primitive, Cone):
            jacobian[6, 5] = 1
    return jacobian


# p, q, ... (n,), number (n,) -> residuals (n, m) that vanish when the relation holds; lengths in the unit frame.
Equation = Callable[..., Stack]
_rows = np.column_stack  # scalars (n,) and vectors (n, 3) side by side


def dot(a: Stack, b: Stack) -> Stack:
    """Scalar products (n,)."""
    return np.asarray((a * b).sum(axis=-1))


def _length(a: Stack) -> Stack:
    return np.asarray(np.sqrt(dot(a, a) + 1e-40))  # with a derivative, zero, at zero


def _off_axis(p: Placed, q: Placed) -> Stack:
    """Vector (n, 3) across the axis of p, as long as q's position is away from it."""
    return np.cross(q.position - p.position, p.direction)


def _along(p: Placed, q: Placed) -> Stack:
    """How far q's position lies along the direction of p (n,)."""
    return dot(q.position - p.position, p.direction)


def _height(p: Placed, q: Placed) -> Stack:
    """Signed distance (n,) of q's position from the plane p."""
    return dot(p.direction, q.position) - p.size


def _parallel(p: Placed, q: Placed, s: Stack) -> Stack:
    return np.cross(p.direction, q.direction)


def _perpendicular(p: Placed, q: Placed, s: Stack) -> Stack:
    return dot(p.direction, q.direction)[:, None]


def _concentric(p: Placed, q: Placed, s: Stack) -> Stack:
    return _off_axis(p, q)


def _coaxial(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([np.cross(p.direction, q.direction), _off_axis(p, q)])


def _coplanar(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([np.cross(p.direction, q.direction), p.size - s * q.size])


def _equal_radius(p: Placed, q: Placed, s: Stack) -> Stack:
    return (p.size - q.size)[:, None]


def _equal_minor(p: Placed, q: Placed, s: Stack) -> Stack:
    return (p.size - q.second)[:, None]


def _equal_minors(p: Placed, q: Placed, s: Stack) -> Stack:
    return (p.second - q.second)[:, None]


def _plane_cylinder(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([dot(p.direction, q.direction), s * _height(p, q) - q.size])


def _plane_cone(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([dot(p.direction, q.apex) - p.size, s * dot(p.direction, q.direction) - np.sin(q.size)])


def _plane_sphere(p: Placed, q: Placed, s: Stack) -> Stack:
    return (s * _height(p, q) - q.size)[:, None]


def _plane_torus(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([np.cross(p.direction, q.direction), s * _height(p, q) - q.second])


def _cylinders_side_by_side(p: Placed, q: Placed, s: Stack) -> Stack:
    """s = 1: one outside the other."""
    return _rows([np.cross(p.direction, q.direction), _length(_off_axis(p, q)) - s * q.size - p.size])


def _cylinder_in_cylinder(p: Placed, q: Placed, s: Stack) -> Stack:
    """s = 1: q is the narrower one."""
    apart = _length(_off_axis(p, q)) - s * (p.size - q.size)
    return _rows([np.cross(p.direction, q.direction), apart])


def _cylinder_ball(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([_off_axis(p, q), p.size - q.size])


def _cylinder_ring(p: Placed, q: Placed, s: Stack) -> Stack:
    """A torus around the cylinder's axis; s = 1: outside it."""
    return _rows([_coaxial(p, q, s), q.size - s * q.second - p.size])


def _cylinder_bend(p: Placed, q: Placed, s: Stack) -> Stack:
    """A torus that goes on as the cylinder."""
    in_plane, across = dot(p.direction, q.direction), dot(q.position - p.position, q.direction)
    return _rows([in_plane, across, p.size - q.second, _length(_off_axis(p, q)) - q.size])


def _cone_ball(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([_off_axis(p, q), dot(q.position - p.apex, p.direction) * np.sin(p.size) - q.size])


def _cone_ring(p: Placed, q: Placed, s: Stack) -> Stack:
    """A torus around the cone's axis; s = 1: outside it."""
    height = dot(q.position - p.apex, p.direction)
    gap = s * (q.size * np.cos(p.size) - height * np.sin(p.size)) - q.second
    return _rows([_coaxial(p, q, s), gap])


def _ball_bend(p: Placed, q: Placed, s: Stack) -> Stack:
    """A torus that ends in the sphere."""
    across = dot(p.position - q.position, q.direction)
    return _rows([across, p.size - q.second, _length(p.position - q.position) - q.size])


def _ball_ring(p: Placed, q: Placed, s: Stack) -> Stack:
    """A torus around an axis of the sphere; s = 1: outside it."""
    centres = np.sqrt(q.size**2 + _along(q, p) ** 2)
    return _rows([_off_axis(q, p), centres - p.size - s * q.second])


def _rings(p: Placed, q: Placed, s: Stack) -> Stack:
    """Two tori about one axis; s = 1: tubes side by side."""
    centres = np.sqrt((p.size - q.size) ** 2 + _along(p, q) ** 2)
    return _rows([_coaxial(p, q, s), centres - p.second - s * q.second])


def _same_cylinder(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([_coaxial(p, q, s), p.size - q.size])


def _same_cone(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([p.direction - q.direction, p.apex - q.apex, p.size - q.size])


def _same_sphere(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([p.position - q.position, p.size - q.size])


def _same_torus(p: Placed, q: Placed, s: Stack) -> Stack:
    return _rows([np.cross(p.direction, q.direction), p.position - q.position, p.size - q.size, p.second - q.second])


EQUATIONS: dict[str, Equation] = {
    "parallel": _parallel,
    "perpendicular": _perpendicular,
    "concentric": _concentric,
    "coaxial": _coaxial,
    "coplanar": _coplanar,
    "equal_radius": _equal_radius,
    "equal_minor": _equal_minor,
    "equal_minors": _equal_minors,
}

# Ways to be tangent, by kinds in the order of the registry.
TANGENCIES: dict[tuple[str, str], tuple[Equation, ...]] = {
    ("plane", "cylinder"): (_plane_cylinder,),
    ("plane", "cone"): (_plane_cone,),
    ("plane", "sphere"): (_plane_sphere,),
    ("plane", "torus"): (_plane_torus,),
    ("cylinder", "cylinder"): (_cylinders_side_by_side, _cylinder_in_cylinder),
    ("cylinder", "sphere"): (_cylinder_ball,),
    ("cylinder", "torus"): (_cylinder_ring, _cylinder_bend),
    ("cone", "sphere"): (_cone_ball,),
    ("cone", "torus"): (_cone_ring,),
    ("sphere", "torus"): (_ball_bend, _ball_ring),
    ("torus", "torus"): (_rings,),
}

# Where the two touch, their own normals agree in these ways; in the other ways they do where the sign is -1.
ALIKE = (_cylinder_in_cylinder, _cylinder_ball, _cylinder_bend, _cone_ball, _ball_bend)

# One surface in two patches: the tangencies above are singular there.
SAME: dict[str, Equation] = {
    "plane": _coplanar,
    "cylinder": _same_cylinder,
    "cone": _same_cone,
    "sphere": _same_sphere,
    "torus": _same_torus,
}


def residuals(equation: Equation, *stacks: Array) -> Array:
    """Residuals (n, m) for the members' placements, (n, 8) each, and last the numbers (n,)."""
    return np.asarray(equation(*map(Placed, stacks[:-1]), stacks[-1]))


def residual_jacobian(equation: Equation, *stacks: Array) -> Array:
    """Derivative (n, m, 8 k) of the residuals by the numbers that place the k members, by a complex step."""
    step, width = 1e-30, PLACEMENT * (len(stacks) - 1)
    together = np.concatenate(stacks[:-1], axis=1)[:, None, :] + 1j * step * np.eye(width)
    members = together.reshape(-1, len(stacks) - 1, PLACEMENT).swapaxes(0, 1)
    changed = equation(*map(Placed, members), np.repeat(stacks[-1], width))
    return np.asarray(changed.imag / step).reshape(len(stacks[0]), width, -1).transpose(0, 2, 1)
