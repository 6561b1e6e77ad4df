"""Freeform patches that are analytic as far as anyone can see."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.fitting import fit
from sed2cad.primitives.base import Primitive
from sed2cad.primitives.robust_fit import UNSEEN
from sed2cad.primitives.simplest import analytic_instead
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.tensor_patch import TensorPatch
from sed2cad.primitives.vectors import unit
from tests.primitives.patches import Sample, sphere_patch


def freeform(sample: Sample) -> TensorPatch:
    found = fit("bspline", sample.points, sample.normals, 1e-5)
    assert found is not None and isinstance(found[0], TensorPatch)
    return found[0]


def instead(sample: Sample) -> Primitive | None:
    surface = freeform(sample)
    found = analytic_instead(sample.points, sample.normals, 1e-5, surface, surface.shape_numbers)
    return found and found[0]


def cap(seed: int, deviation: float) -> Sample:
    """A cap of a sphere whose points lie inside it as those on the chords of a tessellation do."""
    rng = np.random.default_rng(seed)
    sample = sphere_patch(rng, 600, radius=0.2, cap=50.0)
    assert isinstance(sample.truth, Sphere)
    radial = unit(sample.points - sample.truth.centre)
    return Sample(sample.truth, sample.points - rng.uniform(0, deviation, (600, 1)) * radial, sample.normals)


def test_a_tessellated_sphere_is_a_sphere() -> None:
    found = instead(cap(1, 3 * UNSEEN))
    assert isinstance(found, Sphere)
    assert found.radius == pytest.approx(0.2, abs=3 * UNSEEN)


@pytest.mark.parametrize("wave", [10 * UNSEEN, 100 * UNSEEN])
def test_a_sphere_with_a_wave_that_is_to_be_seen_stays_freeform(wave: float) -> None:
    plain = cap(2, 0.0)
    assert isinstance(plain.truth, Sphere)
    radial = unit(plain.points - plain.truth.centre)
    bent = Sample(plain.truth, plain.points + wave * np.sin(25 * plain.points[:, :1]) * radial, plain.normals)
    assert instead(bent) is None


def test_normals_that_point_elsewhere_are_believed() -> None:
    sample = cap(3, 0.0)
    turned = unit(sample.normals + 0.5 * np.roll(sample.normals, 1, axis=1))
    surface = freeform(sample)
    assert analytic_instead(sample.points, turned, 1e-5, surface, surface.shape_numbers) is None
