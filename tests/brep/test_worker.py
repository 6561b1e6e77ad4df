"""A crash or a hang of the kernel is a failure with a sentence, never ours."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from sed2cad.brep import worker
from sed2cad.brep.attempt import Attempt
from sed2cad.brep.build import assemble
from sed2cad.brep.worker import Failure, run_alone, run_isolated, warm_up
from tests.brep import jobs
from tests.geometry import parts


def test_a_result_comes_back_and_the_worker_is_used_again() -> None:
    assert run_isolated(jobs.double, 21, 30.0) == 42
    assert run_isolated(jobs.process_id, None, 30.0) == run_isolated(jobs.process_id, None, 30.0)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_crash_is_a_failure_and_the_next_job_runs() -> None:
    failed = run_isolated(jobs.crash, None, 30.0)
    assert failed == Failure("crash", "the CAD kernel crashed (SIGSEGV)")
    assert run_isolated(jobs.double, 1, 30.0) == 2


def test_a_hang_is_stopped_in_time() -> None:
    run_isolated(jobs.double, 0, 30.0)  # so that the start does not count
    start = time.monotonic()
    failed = run_isolated(jobs.hang, 60.0, 0.5)
    assert time.monotonic() - start < 5
    assert failed == Failure("timeout", "the CAD kernel did not finish within 0.5 s")


def test_an_exception_is_a_failure_and_keeps_the_worker() -> None:
    before = run_isolated(jobs.process_id, None, 30.0)
    assert run_isolated(jobs.complain, "no such face", 30.0) == Failure("error", "ValueError: no such face")
    assert run_isolated(jobs.process_id, None, 30.0) == before


def test_what_the_kernel_prints_does_not_disturb() -> None:
    assert run_isolated(jobs.shout, "Statistics on Transfer", 30.0) == "Statistics on Transfer"


def test_warm_up_does_not_wait() -> None:
    start = time.monotonic()
    warm_up()
    assert time.monotonic() - start < 1
    assert worker._idle


def test_a_second_worker_stands_by_where_the_kernel_hangs() -> None:
    before = run_isolated(jobs.process_id, None, 30.0)
    warm_up(2)
    waiting = {idle._process.pid for idle in worker._idle}
    assert len(waiting) >= 2
    assert run_isolated(jobs.process_id, None, 30.0) == before  # the one that is ready
    assert isinstance(run_isolated(jobs.hang, 60.0, 0.5), Failure)
    assert run_isolated(jobs.process_id, None, 30.0) in waiting - {before}


def test_a_script_without_a_guard_can_use_it() -> None:
    lines = [
        f"import sys; sys.path[:] = {sys.path!r}",
        "from sed2cad.brep.worker import run_isolated",
        "from tests.brep import jobs",
        "print(run_isolated(jobs.double, 4, 30.0))",
    ]
    code = "\n".join(lines)
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (ran.stdout, ran.stderr) == ("8\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_process_for_one_job() -> None:
    assert run_alone(jobs.process_id, None, 30.0) != run_alone(jobs.process_id, None, 30.0)
    assert run_alone(jobs.crash, None, 30.0) == Failure("crash", "the process crashed (SIGSEGV)")
    assert run_alone(jobs.hang, 60.0, 0.5) == Failure("timeout", "the process did not finish within 0.5 s")


def test_a_worker_of_a_worker_ends_with_it(tmp_path: Path) -> None:
    above, below = run_alone(jobs.beat_below, tmp_path / "beats", 30.0)
    assert above != below
    end, sizes = time.monotonic() + 20, [0, 1]
    while sizes[-1] != sizes[-2] and time.monotonic() < end:
        time.sleep(1)
        sizes.append((tmp_path / "beats").stat().st_size)
    assert sizes[-1] == sizes[-2] > 0


def test_a_solid_from_the_worker() -> None:
    part = parts.box_with_hole()
    result = run_isolated(assemble, Attempt(part.topology, part.fitted, part.frame, part.points), 60.0)
    assert not isinstance(result, Failure)
    assert result.gate.passed
    assert result.gate.volume == pytest.approx(part.volume, rel=1e-9)
