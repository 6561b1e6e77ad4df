"""Control nets: sheets that no base carries, distances, folds, round trips."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from sed2cad.fitting import fit
from sed2cad.geometry.extend import extended_net
from sed2cad.primitives.base import Array
from sed2cad.primitives.freeform_fit import fit_freeform, folded
from sed2cad.primitives.net_fit import fit_net
from sed2cad.primitives.net_surface import NetSurface
from sed2cad.primitives.registry import read_primitive
from sed2cad.primitives.unroll import unrolled
from tests.primitives.patches import random_rotation
from tests.primitives.sheets import belt, flank, hose

COUNT = 2000


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module", params=[flank, hose], ids=["flank", "hose"])
def fitted(request: pytest.FixtureRequest) -> tuple[NetSurface, Array, Array]:
    """A net, and other points of its sheet with their normals."""
    found = fit_freeform(*request.param(COUNT))
    assert isinstance(found, NetSurface)
    return found, *request.param(600, 1)


def test_what_winds_and_what_bends_is_found(fitted: tuple[NetSurface, Array, Array]) -> None:
    surface, points, normals = fitted
    assert surface.closed == (abs(points[:, 2]).max() < 0.06)  # the hose
    assert rms(surface.distance(points)) < 6e-5
    agree = np.einsum("ij,ij->i", surface.normal(points), normals)
    assert np.abs(agree).min() > 0.99 and np.sign(agree).sum() in (-600, 600)


def test_the_distance_is_that_to_the_nearest_point(fitted: tuple[NetSurface, Array, Array]) -> None:
    surface, points, normals = fitted
    side = surface.side(points, normals)
    for height in (0.015, -0.015):
        away = points + height * normals
        assert np.median(np.abs(side * surface.distance(away) - height)) < 1e-4
        assert np.quantile(np.linalg.norm(surface.project(away) - points, axis=1), 0.95) < 2e-3
    assert surface.distance(surface.project(points)) == pytest.approx(0, abs=1e-7)


def test_a_belt_with_a_bight_closes() -> None:
    surface = fit_freeform(*belt(4000))
    assert isinstance(surface, NetSurface) and surface.closed
    assert rms(surface.distance(belt(500, 1)[0])) < 2e-5
    low, high = surface.domain
    ends = np.array([[low[0], low[1]], [high[0], low[1]]])
    for order in (0, 1, 2):
        at_ends = surface.at(ends) if order == 0 else surface.tangents(ends)[order]
        assert np.ptp(at_ends, axis=0) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("sheet", [flank, hose])
def test_noise_is_smoothed_not_followed(sheet) -> None:
    points, normals = sheet(COUNT)
    noisy = points + 0.001 * np.random.default_rng(0).normal(size=(COUNT, 1)) * normals
    found = fit("bspline", noisy, normals, 0.001)
    assert found is not None and isinstance(found[0], NetSurface)
    assert rms(found[0].distance(sheet(500, 1)[0])) < 6e-4


def test_the_fit_moves_with_its_points() -> None:
    points, normals = flank(1200)
    rng = np.random.default_rng(5)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    found = fit_freeform(points @ turn.T + shift, normals @ turn.T)
    assert found is not None
    assert rms(found.distance(flank(500, 1)[0] @ turn.T + shift)) < 6e-5


def test_a_net_turned_inside_out_halfway_is_folded() -> None:
    points, normals = flank(1200)
    fit_ = fit_net(points, unrolled(points, normals)[0], 0.0)
    assert fit_ is not None and not folded(fit_, points, normals)
    crumpled = fit_.surface.net.copy()
    crumpled[10:14] = crumpled[13:9:-1]
    assert folded(replace(fit_, surface=replace(fit_.surface, net=crumpled)), points, normals)
    assert unrolled(points[:8], normals[:8]) == []


def test_scaled_and_round_trip(fitted: tuple[NetSurface, Array, Array]) -> None:
    surface, points, _ = fitted
    points = points[:100] + 0.004
    larger = surface.scaled(3.0, np.array([1.0, 2.0, 3.0]))
    assert larger.distance(3 * points + [1, 2, 3]) == pytest.approx(3 * surface.distance(points), abs=1e-7)
    again = read_primitive("bspline", json.loads(json.dumps(surface.parameters())))
    assert isinstance(again, NetSurface)
    assert again.distance(points) == pytest.approx(surface.distance(points), abs=1e-12)


def test_damaged_parameters_are_refused(fitted: tuple[NetSurface, Array, Array]) -> None:
    parameters = fitted[0].parameters()
    back = parameters["knots_v"][::-1]
    for name, value in (("closed", None), ("knots_u", [0, 1]), ("net", [[1.0]]), ("net", "x"), ("knots_v", back)):
        with pytest.raises(ValueError):
            read_primitive("bspline", {**parameters, name: value})


def test_it_goes_on_beyond_its_borders(fitted: tuple[NetSurface, Array, Array]) -> None:
    surface, points, _ = fitted
    longer, (low, high) = extended_net(surface, 0.02), surface.domain
    assert rms(longer.distance(points)) < 2e-4
    grown = longer.domain[1] - high
    assert grown[1] == pytest.approx(0.02) and grown[0] == pytest.approx(0.0 if surface.closed else 0.02)
    beyond = longer.at(np.column_stack([np.linspace(low[0], high[0], 50), np.full(50, high[1] + 0.015)]))
    assert np.abs(surface.distance(beyond)).min() > 0.005


@pytest.mark.parametrize("count", [6, 8, 13, 21, 29, 40])
def test_a_few_points_of_a_sheet_get_a_surface(count: int) -> None:
    """Too few for many breaks along the sheet, or for any."""
    rng = np.random.default_rng(count)
    turn, up = 3 * rng.uniform(-1, 1, count), rng.uniform(-1, 1, count)
    normals = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    points = 0.1 * (normals + [0, 0, 1] * (0.2 * up + 0.1 * turn)[:, None])
    found = fit_freeform(points, normals)
    assert found is not None and np.isfinite(found.distance(points)).all()
