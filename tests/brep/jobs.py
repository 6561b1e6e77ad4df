"""Jobs for the worker's tests; a child process imports them from here."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

from sed2cad.brep.worker import run_isolated


def double(number: int) -> int:
    return 2 * number


def process_id(_: None) -> int:
    return os.getpid()


def only_in(process: int) -> int:
    """Dies in any other process than this one."""
    if os.getpid() != process:
        os.kill(os.getpid(), signal.SIGKILL)
    return process


def crash(_: None) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(seconds: float) -> None:
    time.sleep(seconds)


def shout(text: str) -> str:
    os.write(1, text.encode())  # as the kernel does, past Python
    return text


def complain(sentence: str) -> None:
    raise ValueError(sentence)


def beat(path: Path) -> int:
    """Let a file grow for as long as this process lives."""

    def grow() -> None:
        while True:
            with path.open("a") as file:
                file.write(".")
            time.sleep(0.05)

    threading.Thread(target=grow, daemon=True).start()
    return os.getpid()


def beat_below(path: Path) -> tuple[int, object]:
    """The same in a worker of this worker."""
    return os.getpid(), run_isolated(beat, path, 30.0)
