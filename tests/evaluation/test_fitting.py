"""The Cramer-Rao bound in closed form, and the benchmark of fits: fair to a good one, hard on a biased one."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from sed2cad.cli import app
from sed2cad.evaluation import fitting as benchmark
from sed2cad.evaluation.bound import chart_coordinates, cramer_rao
from sed2cad.evaluation.choice import distinction
from sed2cad.evaluation.fitting import Cell, FittingSettings, evaluate_fitting, score_cell
from sed2cad.evaluation.fitting_tables import fitting_text, targets
from sed2cad.evaluation.true_patches import true_patch
from sed2cad.fitting import fit
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.registry import ANALYTIC_KINDS
from sed2cad.primitives.sphere import Sphere
from tests.primitives.patches import Z
from tests.primitives.test_analytic import examples

SIGMA = 1e-3


def grid(count):
    """A symmetric square of points (count^2, 3) in z = 0, 2 wide."""
    side = np.linspace(-1, 1, count)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    return np.column_stack([x, y, np.zeros_like(x)])


def test_the_bound_of_a_plane():
    """Offset sigma^2 / n, tilts sigma^2 over the sum of the squares of x and y."""
    feet = grid(7)
    covariance = cramer_rao(Plane(Z, 0.0), feet, SIGMA)
    assert covariance == pytest.approx(SIGMA**2 * np.diag([1, 1, 1] / np.array([*(feet[:, :2] ** 2).sum(0), 49])))


def test_the_bound_of_a_full_sphere():
    """The mean of n n^T is I / 3: centre 3 sigma^2 / n along each axis, radius sigma^2 / n, not correlated."""
    corners = np.vstack([np.eye(3), -np.eye(3)])
    covariance = cramer_rao(Sphere(np.zeros(3), 0.5), 0.5 * corners, SIGMA)
    assert covariance == pytest.approx(SIGMA**2 / 6 * np.diag([3, 3, 3, 1]), abs=1e-18)


def test_the_bound_of_a_full_cylinder():
    """Tilts 2 sigma^2 / sum h^2, centre 2 sigma^2 / n, radius sigma^2 / n."""
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = np.column_stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), 0 * angle])
    feet = np.vstack([ring + 0.4 * Z, ring - 0.4 * Z])
    covariance = cramer_rao(Cylinder(Z, np.zeros(3), 0.3), feet, SIGMA)
    tilt = 2 / (16 * 0.4**2)
    assert covariance == pytest.approx(SIGMA**2 * np.diag([tilt, tilt, 2 / 16, 2 / 16, 1 / 16]), abs=1e-18)


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_the_bound_scales_with_the_part(primitive):
    """Lengths grow with the part and its noise, angles do not."""
    feet = primitive.project(np.random.default_rng(0).normal(size=(60, 3)))
    feet = feet[np.linalg.norm(feet - getattr(primitive, "apex", 9.0), axis=1) > 1e-3]
    lengths = {"plane": [2], "cylinder": [2, 3, 4], "cone": [2, 3, 4], "sphere": range(4), "torus": range(2, 7)}
    units = np.ones(primitive.freedom)
    units[list(lengths[primitive.kind])] = 7.0
    small = cramer_rao(primitive, feet, SIGMA)
    large = cramer_rao(primitive.scaled(7.0, np.zeros(3)), 7 * feet, 7 * SIGMA)
    assert large == pytest.approx(small * units[:, None] * units, rel=1e-6, abs=1e-9 * np.abs(small).max())


@pytest.mark.parametrize("primitive", examples(), ids=lambda p: p.kind)
def test_chart_coordinates_invert_the_chart(primitive):
    for seed in range(5):
        delta = 0.05 * np.random.default_rng(seed).normal(size=primitive.freedom)
        assert chart_coordinates(primitive, primitive.moved(delta)) == pytest.approx(delta, abs=1e-12)


def test_axes_have_no_direction():
    cylinder = Cylinder(Z, np.zeros(3), 0.3)
    assert chart_coordinates(cylinder, Cylinder(-Z, 5 * Z, 0.4)) == pytest.approx([0, 0, 0, 0, 0.1])
    assert chart_coordinates(Plane(Z, 1.0), Plane(-Z, -1.5)) == pytest.approx([0, 0, 0.5])


@pytest.mark.parametrize("kind", ANALYTIC_KINDS)
def test_a_patch_is_what_it_says(kind):
    patch = true_patch(kind, 400, 90.0, SIGMA, 0.2, np.random.default_rng(0))
    distance = patch.primitive.distance(patch.points)
    assert patch.primitive.distance(patch.feet) == pytest.approx(0, abs=1e-12)
    assert (~patch.inlier).sum() == 80
    assert np.std(distance[patch.inlier]) == pytest.approx(SIGMA, rel=0.15)
    assert np.abs(distance[~patch.inlier]).mean() > 10 * SIGMA


def test_a_biased_fit_misses_the_bound():
    """A radius that is one in a thousand too large is seen; so is a covariance that claims half the error."""
    cell = Cell("sphere", SIGMA, 500, 360.0, 0.0)

    def biased(kind, points, normals, noise):
        found, rms, covariance = fit(kind, points, normals, noise)
        return replace(found, radius=1.001 * found.radius), rms, covariance

    def proud(kind, points, normals, noise):
        found, rms, covariance = fit(kind, points, normals, noise)
        return found, rms, covariance / 4

    fair, bent, boast = (score_cell(cell, 20, fitter) for fitter in (fit, biased, proud))
    assert max(fair.ratios) < 1.5 and 0.5 < fair.honesty < 1.6 and fair.inside > 0.8
    assert max(bent.ratios) > 5 and bent.honesty > 5
    assert boast.honesty == pytest.approx(4 * fair.honesty, rel=1e-3) and boast.inside < 0.7


def test_distinction_is_the_distinguishing_parameter_in_sigma():
    """A cap that is nearly flat: its curvature over the bound of the curvature, sigma(r) / r^2."""
    rng, radius = np.random.default_rng(0), 20.0
    flat = rng.uniform(-0.2, 0.2, (500, 2))
    feet = np.column_stack([flat, np.sqrt(radius**2 - (flat**2).sum(axis=1))])
    sphere = Sphere(np.zeros(3), radius)
    spread = np.sqrt(cramer_rao(sphere, feet, 1e-5)[3, 3])
    assert distinction(sphere, feet, 1e-5) == pytest.approx(radius / spread, rel=0.02)
    assert distinction(Plane(Z, 0.0), grid(5), SIGMA) == np.inf


def test_the_tables_of_a_small_run():
    result = evaluate_fitting(FittingSettings(2, 1, (SIGMA,), (100,), (180.0,), (0.0,), (20.0,)))
    text = fitting_text(result)
    for words in ("kind ", "chosen ", "near the limit", "B-spline ", "worst cells", "target "):
        assert any(line.startswith(words) for line in text.splitlines())
    assert {row.cell.shape for row in result.cells} == set(ANALYTIC_KINDS)
    assert all(target.held for target in targets(result) if "error / bound, median" in target.name)


def test_the_command(monkeypatch, tmp_path):
    small = FittingSettings(1, 1, (SIGMA,), (100,), (90.0,), (0.0, 0.2), (20.0,))
    monkeypatch.setattr(benchmark, "FittingSettings", lambda seeds, workers: replace(small, seeds=seeds))
    file = tmp_path / "fitting.json"
    result = CliRunner().invoke(app, ["evaluate", "fitting", "--seeds", "2", "--json", str(file)])
    assert result.exit_code == 0, result.stderr
    assert "seconds for a part of 40 faces" in result.stdout
    assert "14 of 14 cells" in result.stderr
    content = json.loads(file.read_text())
    assert content["settings"]["seeds"] == 2
    assert len(content["cells"]) == 10 and len(content["splines"]) == 4
    assert all({"name", "value", "limit", "held"} <= set(target) for target in content["targets"])
    refused = CliRunner().invoke(app, ["evaluate", "fitting", "--json", str(tmp_path)])
    assert refused.exit_code == 2 and "give --json a file name" in refused.stderr
