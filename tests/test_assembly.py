"""The ladder: what happens when the better rungs fail."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import sed2cad
from sed2cad import assembly, climbing, rungs
from sed2cad.brep.attempt import Verdict
from sed2cad.brep.beside import Crew
from sed2cad.brep.jobs import assemble_faceted, judge
from sed2cad.brep.worker import Failure
from sed2cad.errors import AssemblyError
from sed2cad.mending import Flawed
from sed2cad.scan.raw import RawScan
from tests.parts import DATA
from tests.segmentation.shapes import box

Job = Callable[[Any], Any]


def box_scan() -> RawScan:
    points, normals, _ = box((30.0, 20.0, 10.0), 2000)
    return RawScan(points, normals, name="box")


def runs(monkeypatch: pytest.MonkeyPatch, run: Callable[[Job, Any, float], Any]) -> None:
    """All jobs of the kernel go to `run`."""
    monkeypatch.setattr(assembly, "run_isolated", run)
    monkeypatch.setattr(Crew, "run", lambda crew, job, payload, timeout: run(job, payload, timeout))


def kernel(monkeypatch: pytest.MonkeyPatch, faceted: Job) -> None:
    """A kernel on which every exact attempt crashes and facets are made by `faceted`."""

    def run(job: Job, payload: Any, timeout: float) -> Any:
        return faceted(payload) if job is assemble_faceted else Failure("crash", "the CAD kernel crashed")

    runs(monkeypatch, run)


def test_facets_are_the_last_rung_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel(monkeypatch, assemble_faceted)
    model = sed2cad.reconstruct(box_scan())
    assert model.report.closed and model.report.rung == "facets" and model.report.exact_faces == 0
    of_a_box = [rung for rung in rungs.LADDER if rung.walls and rung.proxy != "thick"]
    assert model.report.reason.count("the CAD kernel crashed") == len(of_a_box)
    assert any("facets" in warning for warning in model.report.warnings)
    assert model.solid.volume == pytest.approx(6000, rel=0.02)
    with pytest.raises(sed2cad.errors.UsageError, match="facets"):
        model.vary(plane_1={"offset": 1.0})


def test_a_solid_without_constraints_is_said_to_be_one(monkeypatch: pytest.MonkeyPatch) -> None:
    attempts: list[Any] = []

    def run(job: Job, payload: Any, timeout: float) -> Any:
        attempts.append(payload)
        return Failure("crash", "the CAD kernel crashed") if len(attempts) == 1 else job(payload)

    runs(monkeypatch, run)
    report = sed2cad.reconstruct(DATA / "bracket.ply").report
    assert report.rung == rungs.UNREGULARISED and not report.constraints
    assert any("no solid passed" in warning for warning in report.warnings)


def test_an_open_shell_is_kept_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(payload: Any) -> Any:
        made = assemble_faceted(payload)
        return replace(made, gate=replace(made.gate, closed=False, passed=False, reason="the shell is not closed"))

    kernel(monkeypatch, opened)
    report = sed2cad.reconstruct(box_scan()).report
    assert not report.closed
    assert any("the shell is not closed" in warning for warning in report.warnings)


def test_facets_that_fail_are_tried_finer(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []

    def bad_at_first(payload: Any) -> Any:
        counts.append(len(payload.mesh.faces))
        made = assemble_faceted(payload)
        return replace(made, gate=replace(made.gate, passed=False, reason="no good")) if len(counts) < 3 else made

    kernel(monkeypatch, bad_at_first)
    report = sed2cad.reconstruct(box_scan()).report
    assert report.closed and report.rung == "facets" and len(counts) == 3
    assert counts[0] < counts[1] < counts[2]


def test_nothing_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel(monkeypatch, lambda payload: Failure("timeout", "the CAD kernel did not finish"))
    with pytest.raises(AssemblyError, match="did not finish"):
        sed2cad.reconstruct(box_scan())


def test_no_new_attempt_after_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel(monkeypatch, assemble_faceted)
    model = sed2cad.reconstruct(box_scan(), sed2cad.Settings(exact_seconds=1e-9))
    assert "not tried" in model.report.reason
    assert model.report.rung == "facets"


def test_walls_are_put_in_once_for_each_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel(monkeypatch, assemble_faceted)
    walled, seen = rungs.walled, []

    def counted(scan: Any, topology: Any, fitted: Any) -> Any:
        seen.append(topology)
        return walled(scan, topology, fitted)

    monkeypatch.setattr(rungs, "walled", counted)
    sed2cad.reconstruct(box_scan())
    assert len(seen) == len({rung.key for rung in rungs.LADDER if rung.proxy != "thick"})


def test_a_solid_with_a_face_that_cannot_be_drawn_is_better_than_facets(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said, and of several the one with the fewest such faces is taken."""
    hidden = iter([2, 1, 3, 3, 3])

    def run(job: Job, payload: Any, timeout: float) -> Any:
        if job is not judge:
            return Failure("crash", "the CAD kernel crashed")
        undrawn = next(hidden)
        made = job(payload).result
        gate = replace(made.gate, passed=False, reason="it cannot be drawn", undrawn=undrawn)
        return Verdict(replace(made, gate=gate), gate.reason, ())

    runs(monkeypatch, run)
    report = sed2cad.reconstruct(box_scan()).report
    assert report.rung == rungs.UNREGULARISED and report.exact_faces == 6
    assert any("did not pass all checks: it cannot be drawn" in warning for warning in report.warnings)


def test_after_the_first_attempt_two_are_tried_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each waits until another is under way; of both solids the one higher up is taken."""
    alone, together = iter([True]), threading.Barrier(2, timeout=60.0)

    def run(job: Job, payload: Any, timeout: float) -> Any:
        if next(alone, False):
            return Failure("crash", "the CAD kernel crashed")
        together.wait()
        return job(payload)

    runs(monkeypatch, run)
    assert sed2cad.reconstruct(box_scan()).report.rung == rungs.UNREGULARISED


def test_the_first_attempt_that_fails_gets_a_second_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the regions to blame; what comes of it is tried before any other rung."""
    looked: list[tuple[int, ...]] = []

    def run(job: Job, payload: Any, timeout: float) -> Any:
        return job(payload) if looked else Verdict(None, "a face is open", (3,))

    def again(scan: Any, flawed: Flawed, blamed: tuple[int, ...]) -> Flawed:
        looked.append(blamed)
        return replace(flawed, looked=True)

    runs(monkeypatch, run)
    monkeypatch.setattr(climbing, "looked_again", again)
    report = sed2cad.reconstruct(box_scan()).report
    assert report.rung == "exact, second look" and report.exact_faces == 6
    assert looked == [(3,)] and "a face is open" in report.reason
