"""The command's process ends at once, with its exit code and all of its output."""

from __future__ import annotations

import gc
import subprocess
import sys

import pytest

from sed2cad.process import uncollected

ENDINGS = [("pass", 0), ("sys.exit(4)", 4), ("sys.exit('no')", 1), ("raise ValueError", 1)]


@pytest.mark.parametrize(("ending", "code"), ENDINGS, ids=[ending for ending, _ in ENDINGS])
def test_exit_code_and_output(ending: str, code: int) -> None:
    lines = f"import sys\nfrom sed2cad.process import run_and_end\ndef job():\n    print('said')\n    {ending}\n"
    done = subprocess.run([sys.executable, "-c", f"{lines}run_and_end(job)"], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("said\n", code)


def test_a_running_worker_does_not_outlive_the_command() -> None:
    lines = (
        "from sed2cad.brep import worker\nfrom sed2cad.process import run_and_end\n"
        "def job():\n    worker.warm_up()\n    print(worker._idle[0]._process.pid)\n"
    )
    done = subprocess.run([sys.executable, "-c", f"{lines}run_and_end(job)"], capture_output=True, text=True)
    found = subprocess.run(["kill", "-0", done.stdout.strip()], capture_output=True)
    assert done.returncode == 0 and found.returncode != 0


def test_collecting_goes_on_afterwards() -> None:
    with uncollected():
        assert not gc.isenabled()
    assert gc.isenabled()
    gc.unfreeze()
