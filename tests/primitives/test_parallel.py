"""Parallel surfaces have their points at one distance."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.primitives.base import Primitive
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.cone import Cone
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.parallel import parallel
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.torus import Torus

AXIS = np.array([1.0, 2.0, 2.0]) / 3
POINT = np.array([0.1, -0.2, 0.05])
SURFACES = [
    Plane(AXIS, 0.1),
    Cylinder(AXIS, POINT, 0.3),
    Cone(AXIS, POINT - AXIS, 0.5),
    Sphere(POINT, 0.4),
    Torus(AXIS, POINT, 0.4, 0.1),
]


@pytest.mark.parametrize("surface", SURFACES, ids=lambda surface: surface.kind)
@pytest.mark.parametrize("by", [0.02, -0.03])
def test_distances_shift(surface: Primitive, by: float) -> None:
    points = surface.project(np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3)))
    moved = parallel(surface, by)
    assert moved is not None
    assert moved.distance(points + by * surface.normal(points)) == pytest.approx(0, abs=1e-12)
    back = parallel(moved, -by)
    assert back is not None and back.distance(points) == pytest.approx(0, abs=1e-12)


def test_what_is_narrower_or_freeform_has_none() -> None:
    assert parallel(Cylinder(AXIS, POINT, 0.02), -0.02) is None
    assert parallel(Torus(AXIS, POINT, 0.4, 0.1), -0.2) is None
    assert parallel(BSplineSurface.__new__(BSplineSurface), 0.01) is None
