"""Faces on a wrong surface are replaced, and only they."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from sed2cad.brep.attempt import Attempt, Options, Verdict
from sed2cad.brep.build import assemble
from sed2cad.brep.kernel import from_bytes, is_closed, is_valid, volume
from sed2cad.brep.worker import Failure
from sed2cad.mending import Flawed, Mended, Mending, mend
from sed2cad.primitives.base import FittedPatch, Primitive
from sed2cad.primitives.loose import loose_patch
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.sphere import Sphere
from sed2cad.scan.scan import Scan
from sed2cad.topology.trace import Traced, trace
from tests.topology import scans

Run = Callable[[Callable[[Attempt], Verdict], Attempt, float], "Verdict | Failure"]


def here(job: Callable[[Attempt], Verdict], attempt: Attempt, _: float) -> Verdict | Failure:
    return job(attempt)


def with_surface(fitted: Sequence[FittedPatch], number: int, primitive: Primitive) -> tuple[FittedPatch, ...]:
    changed = list(fitted)
    changed[number] = replace(changed[number], primitive=primitive)
    return tuple(changed)


def started(scan: Scan, traced: Traced, fitted: tuple[FittedPatch, ...]) -> Attempt:
    surface = np.vstack([scan.points, traced.proxy.vertices])
    return Attempt(traced.topology, fitted, scan.frame, scan.points, Options(), surface)


def mended(pieces: list[scans.Piece], number: int, wrong: Primitive, run: Run = here) -> tuple[Mended | None, str]:
    scan, fitted = scans.scan_of(pieces)
    traced = trace(scan, fitted)
    base = started(scan, traced, with_surface(traced.fitted, number, wrong))
    return mend(scan, Flawed(base, traced), run, 60.0, lambda _: None)


def test_a_flat_face_on_a_wrong_surface_gets_a_plane() -> None:
    tilted = Plane(np.array([0.6, 0.0, 0.8]), 0.2)
    found, reason = mended(scans.box(), 5, tilted)
    assert found is not None and reason == ""
    assert all(face.rung == "exact" for face in found.result.faces)
    assert volume(from_bytes(found.result.brep)) == pytest.approx(0.14, rel=2e-3)


@pytest.mark.parametrize("radius", [0.15, 0.6])
def test_a_round_face_on_a_wrong_surface_is_replaced(radius: float) -> None:
    found, reason = mended(scans.box_with_hole(), 6, Sphere(np.array([0.3, 0.2, 0.1]), radius))
    assert found is not None and reason == ""
    solid = from_bytes(found.result.brep)
    assert is_closed(solid) and is_valid(solid)
    assert volume(solid) == pytest.approx(0.14 - np.pi * 0.12**2 * 0.4, rel=5e-3)
    rungs = {face.primitive if face.rung == "exact" else -1: face.rung for face in found.result.faces}
    assert set(rungs) == {-1, 0, 1, 2, 3, 4, 5}
    assert rungs[-1] in ("freeform", "facets")
    assert all(face.deviation < 0.01 for face in found.result.faces)


def test_a_face_to_blame_is_left_out_of_a_shell_that_is_open_anyway() -> None:
    """It is no surface at all then, and no facets are made of it."""
    scan, fitted = scans.scan_of(scans.box())
    traced = trace(scan, fitted)
    regions = list(traced.topology.regions)
    regions[0] = replace(regions[0], primitive=len(fitted))
    topology = replace(traced.topology, regions=tuple(regions))
    base = replace(started(scan, traced, (*fitted, loose_patch())), topology=topology)
    mending = Mending(base, traced)
    assert len(assemble(mending.attempt()).faces) == 5
    mending.facets.add(1)
    changed = mending.attempt()
    assert changed.topology.regions[1].primitive == len(fitted) and not changed.facets
    result = assemble(changed)
    shell = from_bytes(result.brep)
    assert len(result.faces) == 4 and is_valid(shell) and not is_closed(shell)
    assert result.gate.reason.startswith("only 7") and result.gate.reason.endswith("% of the points lie on it")


def test_nothing_is_mended_without_the_kernel() -> None:
    def crash(*_: object) -> Failure:
        return Failure("crash", "the CAD kernel crashed")

    found, reason = mended(scans.box(), 5, Plane(np.array([0.6, 0.0, 0.8]), 0.2), crash)
    assert found is None and reason == "the CAD kernel crashed"
