"""Two cores: what can be done beside each other, in workers and in threads that wait for them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from sed2cad.brep.worker import Failure, Worker, asked, run_isolated, take

P = TypeVar("P")
R = TypeVar("R")

_FEW = 6  # payloads that are not worth sending
_PATIENCE = 60.0  # seconds until they are done here after all


def run_each(job: Callable[[P], R], payloads: Sequence[P]) -> list[R]:
    """job(payload) of each, every other one in a worker meanwhile: work of any kind, on two cores."""
    if len(payloads) < _FEW:
        return _one_by_one((job, payloads))
    mine, theirs = payloads[::2], payloads[1::2]
    with ThreadPoolExecutor(1) as beside:
        away = beside.submit(run_isolated, _one_by_one, (job, theirs), _PATIENCE)
        here = _one_by_one((job, mine))
        there = away.result()
    done: list[Any] = [None] * len(payloads)
    done[::2], done[1::2] = here, _one_by_one((job, theirs)) if isinstance(there, Failure) else there
    return done


def _one_by_one(work: tuple[Callable[[P], R], Sequence[P]]) -> list[R]:
    job, payloads = work
    return [job(payload) for payload in payloads]


class Crew:
    """Work beside each other that ends when it is no longer wanted: leaving it stops the jobs in its workers.

    Results that are still waited for are then Failures. Threads do the rest, which only ends by itself.
    """

    def __init__(self, threads: int) -> None:
        self._threads = ThreadPoolExecutor(threads)
        self._lock = threading.Lock()
        self._busy: set[Worker] = set()
        self._dismissed = False

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._dismissed = True
            for worker in self._busy:
                worker.kill()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def begin(self, action: Callable[[], R]) -> Future[R]:
        """action() in a thread."""
        return self._threads.submit(action)

    def run(self, job: Callable[[P], R], payload: P, timeout: float) -> R | Failure:
        """As `run_isolated`, but for as long as the crew is wanted only."""
        with self._lock:
            if self._dismissed:
                return Failure("error", "it was not needed any more")
            worker = take()
            self._busy.add(worker)
        result: R | Failure = asked(worker, (job, payload, timeout), self._free)
        return result

    def _free(self, worker: Worker) -> None:
        with self._lock:
            self._busy.remove(worker)
