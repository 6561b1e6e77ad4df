"""How the command's process begins and ends: what costs seconds there and is of no use to one short job."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Callable, Iterator

from sed2cad.brep.worker import stop_workers


def run_and_end(command: Callable[[], object]) -> None:
    """command(), then the end of the process with its exit code, without the time that modules take to be torn down.

    numpy stays on one thread, if it is not loaded yet: the matrices are small, and threads would wait for each other.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    code = 0
    try:
        command()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    stop_workers()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """What is made meanwhile is there to stay, like modules: the garbage collector need not look through it."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
