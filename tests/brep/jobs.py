"""Jobs for the worker's tests; a child process imports them from here."""

from __future__ import annotations

import os
import signal
import time


def double(number: int) -> int:
    return 2 * number


def process_id(_: None) -> int:
    return os.getpid()


def crash(_: None) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(seconds: float) -> None:
    time.sleep(seconds)


def shout(text: str) -> str:
    os.write(1, text.encode())  # as the kernel does, past Python
    return text


def complain(sentence: str) -> None:
    raise ValueError(sentence)
