"""One job in a process of its own, which may crash or hang and whose memory is its alone."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from sed2cad.brep.worker import Failure
from sed2cad.errors import Sed2cadError

P = TypeVar("P")
R = TypeVar("R")


def in_child(job: Callable[[P], R], payload: P, seconds: float) -> R | Failure:
    """job(payload) in a new process, for at most `seconds`, its start included.

    `job` is a function at the top level of a module. A crash, a hang or an exception comes back as a Failure.
    """
    context = multiprocessing.get_context("spawn")
    pipe, end = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(end, job, payload), daemon=True)
    process.start()
    end.close()
    try:
        if not pipe.poll(seconds):
            return Failure("timeout", f"took longer than {seconds:g} s")
        answer: R | Failure = pipe.recv()
        return answer
    except (EOFError, OSError):
        process.join()
        return Failure("crash", f"the process ended with {process.exitcode}")
    finally:
        process.kill()
        process.join()
        pipe.close()


def _serve(pipe: Connection, job: Callable[[Any], Any], payload: Any) -> None:
    """The child's side; what the CAD kernel prints goes nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        answer = job(payload)
    except Sed2cadError as error:
        answer = Failure("error", str(error))
    except Exception as error:
        answer = Failure("error", f"{type(error).__name__}: {error}".strip().splitlines()[0])
    pipe.send(answer)
