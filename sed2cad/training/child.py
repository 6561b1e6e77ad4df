"""A process for jobs that may hang or crash in the CAD kernel."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from multiprocessing.connection import Connection
from typing import Any, TypeVar

Item = TypeVar("Item")
Run = Callable[..., str]
"""Run a job in a child: empty when it was done, else the reason why not."""

START_LIMIT = 60.0
"""Seconds that a child gets for its first job, imports included."""
JOB_LIMIT = 20.0
"""Seconds for each further job: OCC hangs on a few."""


class Child:
    """Runs one function on many arguments in a process, which is replaced when it crashes or takes too long."""

    def __init__(self, job: Callable[..., None], limit: float = JOB_LIMIT) -> None:
        self.job, self.job_limit = job, limit
        self.process: Any = None
        self.limit = 0.0  # of the next job; set where a process starts

    def run(self, *arguments: Any) -> str:
        """Empty when the job was done, else the reason why not."""
        if self.process is None:
            self._start()
        try:
            self.pipe.send(arguments)
            if self.pipe.poll(self.limit):
                self.limit = self.job_limit
                return self.pipe.recv()
            reason = f"took longer than {self.limit:.0f} s"
        except (EOFError, OSError):
            reason = "crashed"
        self.close()
        return reason

    def close(self) -> None:
        """End the process; a later run starts another."""
        if self.process is not None:
            self.process.kill()
            self.process.join()
            self.process = None

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, end = context.Pipe()
        self.process = context.Process(target=_serve, args=(end, self.job), daemon=True)
        self.process.start()
        end.close()
        self.limit = max(START_LIMIT, self.job_limit)


def _serve(pipe: Connection, job: Callable[..., None]) -> None:
    while True:
        arguments = pipe.recv()
        try:
            job(*arguments)
            pipe.send("")
        except Exception as error:  # the parent reports it and goes on with the next job
            pipe.send(str(error) or type(error).__name__)


def in_children(
    job: Callable[..., None],
    items: Sequence[Item],
    one: Callable[[Run, Item], str],
    workers: int,
    limit: float = JOB_LIMIT,
) -> Iterator[tuple[Item, str]]:
    """one(run, item) for each item, as they end, with what it says; each of the workers has a child of its own."""
    local, children = threading.local(), []

    def work(item: Item) -> tuple[Item, str]:
        if not hasattr(local, "child"):
            local.child = Child(job, limit)
            children.append(local.child)
        return item, one(local.child.run, item)

    try:
        with ThreadPoolExecutor(workers) as pool:
            for done in as_completed([pool.submit(work, item) for item in items]):
                yield done.result()
    finally:
        for child in children:
            child.close()
