"""A dome on a surface about its axis cannot close: it gets another one."""

from __future__ import annotations

import numpy as np

from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.bspline_fit import _axis_chart, _refined, fit_over_plane
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Frame, Scan
from sed2cad.topology.closing import closable
from sed2cad.topology.model import Chain, Region, Topology


def test_a_dome_about_an_axis_gets_a_patch_over_a_plane() -> None:
    """An elliptic paraboloid: no sphere, and steep enough at its rim for a base that is a cylinder."""
    rng = np.random.default_rng(0)
    radius, turn = 0.3 * np.sqrt(rng.uniform(0.0, 1, 900)), rng.uniform(0, 2 * np.pi, 900)
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    points = np.column_stack([x, y, -4 * x**2 - 3 * y**2])
    normals = unit(np.column_stack([8 * x, 6 * y, np.ones(900)]))
    rim = radius > 0.15
    about = _refined(_axis_chart(points[rim], normals[rim]), 0.0)[0]
    assert isinstance(about, BSplineSurface) and about.base == "cylinder"
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.column_stack(
        [0.3 * np.cos(angle), 0.3 * np.sin(angle), -0.36 * np.cos(angle) ** 2 - 0.27 * np.sin(angle) ** 2]
    )
    patch = FittedPatch(Patch(np.arange(900), "bspline", np.ones(900, bool)), about, 1, 1e-4, np.zeros((0, 0)))
    topology = Topology((Region(0, (((0, 1),),), points, 0.3, 0),), (Chain(ring, 0, 1, -1, -1),), np.zeros((0, 3)), 1.0)
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), 0.0, 0.01)
    (closed,) = closable(scan, topology, [patch])
    assert closed.primitive.freeform and closed.primitive is not about
    assert not isinstance(closed.primitive, BSplineSurface) or closed.primitive.base == "plane"
    assert closed.rms < 1e-4
    assert closable(scan, topology, [closed]) == [closed]


def test_over_a_plane_where_that_does_not_fold_only() -> None:
    rng = np.random.default_rng(1)
    x, y, turn = rng.uniform(-0.3, 0.3, (3, 800)) * [[1], [1], [np.pi / 0.3]]
    hill = np.column_stack([x, y, np.exp(-10 * (x**2 + y**2)) / 5])
    slope = -4 * np.column_stack([x, y]) * np.exp(-10 * (x**2 + y**2))[:, None]
    found = fit_over_plane(hill, unit(np.column_stack([-slope, np.ones(800)])))
    assert found is not None and found.base == "plane" and np.abs(found.distance(hill)).max() < 1e-3
    tube = np.column_stack([np.cos(turn), np.sin(turn), y])
    assert fit_over_plane(tube, tube * [1, 1, 0]) is None
