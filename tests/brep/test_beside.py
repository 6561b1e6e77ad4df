"""Two cores: jobs are done in order, and what is no longer wanted ends."""

from __future__ import annotations

import os
import time

import pytest

from sed2cad.brep.beside import Crew, run_each
from sed2cad.brep.worker import Failure, run_isolated
from tests.brep import jobs


@pytest.mark.parametrize("count", [0, 1, 7, 40])
def test_each_is_done_in_order_some_of_them_elsewhere(count: int) -> None:
    assert run_each(jobs.double, list(range(count))) == list(range(0, 2 * count, 2))
    processes = set(run_each(jobs.process_id, [None] * count))
    assert len(processes) == (2 if count > 6 else min(count, 1))


def test_what_goes_wrong_elsewhere_is_done_here() -> None:
    """A job that only this process can do."""
    own = os.getpid()
    assert run_each(jobs.only_in, [own] * 8) == [own] * 8


def test_a_crew_that_is_left_stops_its_jobs() -> None:
    run_isolated(jobs.double, 0, 30.0)  # so that the start does not count
    start = time.monotonic()
    with Crew(2) as crew:
        done = crew.begin(lambda: crew.run(jobs.double, 21, 30.0))
        hanging = crew.begin(lambda: crew.run(jobs.hang, 60.0, 60.0))
        assert done.result() == 42
    assert isinstance(hanging.result(), Failure)
    assert time.monotonic() - start < 20
    assert isinstance(crew.run(jobs.double, 21, 30.0), Failure)  # nobody waits for it
    assert run_isolated(jobs.double, 4, 30.0) == 8


def test_a_job_of_a_crew_has_its_time_only() -> None:
    with Crew(1) as crew:
        assert crew.run(jobs.hang, 60.0, 0.5) == Failure("timeout", "the CAD kernel did not finish within 0.5 s")
