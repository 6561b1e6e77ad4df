"""Free-form patches go on beyond their borders."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.geometry.extend import extended, widened
from sed2cad.primitives.bspline import BSplineSurface
from sed2cad.primitives.bspline_fit import fit_bspline
from tests.geometry import parts


def bowl() -> BSplineSurface:
    """A shallow paraboloid over [-0.2, 0.2]^2."""
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 30), np.linspace(-0.2, 0.2, 30))
    points = np.column_stack([x.ravel(), y.ravel(), (x**2 + y**2).ravel()])
    normals = np.column_stack([-2 * points[:, 0], -2 * points[:, 1], np.ones(len(points))])
    found = fit_bspline(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))
    assert found is not None and found.base == "plane"
    return found


def sleeve() -> BSplineSurface:
    """A wavy tube about Z."""
    t, z = np.meshgrid(np.linspace(0, 2 * np.pi, 80, endpoint=False), np.linspace(-0.2, 0.2, 30))
    r = 0.1 + 0.01 * np.cos(2 * t)
    points = np.column_stack([(r * np.cos(t)).ravel(), (r * np.sin(t)).ravel(), z.ravel()])
    slope = -0.02 * np.sin(2 * t)
    across = np.column_stack([(r * np.cos(t) + slope * np.sin(t)).ravel(), (r * np.sin(t) - slope * np.cos(t)).ravel()])
    normals = np.column_stack([across / np.linalg.norm(across, axis=1, keepdims=True), np.zeros(t.size)])
    found = fit_bspline(points, normals)
    assert found is not None and found.base == "cylinder"
    return found


@pytest.mark.parametrize("patch", [bowl(), sleeve()], ids=["plane", "cylinder"])
def test_inside_it_stays_and_outside_it_goes_on(patch: BSplineSurface) -> None:
    longer = extended(patch, 0.04)
    low, high = patch.domain
    rng = np.random.default_rng(0)
    middle = low + (high - low) * rng.uniform(0.05, 0.95, (200, 2))
    points = patch.at(middle)
    assert np.abs(longer.distance(points)).max() < 2e-4
    assert longer.domain[1][1] - high[1] == pytest.approx(0.04)
    beyond = longer.at(np.column_stack([middle[:, 0], np.full(200, high[1] + 0.03)]))
    assert np.abs(longer.distance(beyond)).max() < 1e-9
    assert np.abs(patch.distance(beyond)).max() > 0.01


def test_analytic_surfaces_are_left_alone() -> None:
    fitted = parts.box().fitted[0]
    assert widened(fitted) is fitted
