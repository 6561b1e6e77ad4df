"""One face of a hand-made part is made of facets; the rest stays exact and the solid closed."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.brep.attempt import Attempt, Verdict
from sed2cad.brep.build import judge
from sed2cad.brep.kernel import from_bytes, is_closed, is_valid, volume
from sed2cad.geometry.polygons import Cloud
from sed2cad.primitives.plane import Plane
from tests.brep.made import part
from tests.geometry.parts import Part


def cloud(made: Part, region: int) -> Cloud:
    """Points amid the loops of a face, on its surface."""
    patch, own = made.fitted[region], made.topology.regions[region].points
    rng = np.random.default_rng(0)
    share = rng.uniform(0, 1, (4000, 1))
    a, b = (own[rng.integers(0, len(own), 4000)] for _ in range(2))
    points = patch.primitive.project(share * a + (1 - share) * b)
    return Cloud(points, patch.sign * patch.primitive.normal(points))


def judged(name: str, region: int) -> Verdict:
    made = part(name)
    return judge(Attempt(made.topology, made.fitted, made.frame, made.points, facets={region: cloud(made, region)}))


@pytest.mark.parametrize(
    ("name", "region", "off"),
    [
        ("box", 4, 1e-9),
        ("box_with_hole", 0, 1e-9),
        ("box_with_hole", 6, 0.01),
        ("stepped_shaft", 0, 0.02),
        ("stepped_shaft", 3, 0.02),
        ("filleted_box", 2, 0.01),
        ("pyramid", 1, 1e-9),
    ],
)
def test_the_other_faces_stay_exact(name: str, region: int, off: float) -> None:
    made, verdict = part(name), judged(name, region)
    assert verdict.reason == "" and verdict.result is not None
    solid = from_bytes(verdict.result.brep)
    assert is_valid(solid) and is_closed(solid)
    assert volume(solid) == pytest.approx(made.volume, rel=off)
    exact = [face.region for face in verdict.result.faces if face.rung == "exact"]
    assert sorted(exact) == [r for r in range(len(made.kinds)) if r != region]
    cut = [face for face in verdict.result.faces if face.region == region]
    assert cut and all(face.rung == "facets" and face.kind == "facet" for face in cut)
    assert all(not face.deviation > 0.01 * made.frame.scale for face in cut)


def test_facets_replace_a_surface_that_is_wrong() -> None:
    made = part("box")
    fitted = list(made.fitted)
    tilted = Plane(np.array([0.6, 0.0, 0.8]), fitted[4].primitive.offset)  # type: ignore[attr-defined]
    fitted[4] = type(fitted[4])(fitted[4].patch, tilted, 1, 0.0, fitted[4].covariance)
    wrong = Attempt(made.topology, tuple(fitted), made.frame, made.points)
    assert judge(wrong).reason != ""
    right = judge(Attempt(made.topology, tuple(fitted), made.frame, made.points, facets={4: cloud(made, 4)}))
    assert right.reason == "" and right.result is not None
    assert volume(from_bytes(right.result.brep)) == pytest.approx(made.volume, rel=1e-6)


def test_a_face_that_cannot_close_is_to_blame() -> None:
    made = part("stepped_shaft")
    fitted = list(made.fitted)
    fitted[4] = made.fitted[1]  # the top lies on the thin cylinder
    verdict = judge(Attempt(made.topology, tuple(fitted), made.frame, made.points))
    assert verdict.result is None and "open on one side" in verdict.reason
    assert verdict.blamed == (4,)
