"""Work on the CAD kernel in a child process, because it can crash or hang.

A worker is a plain Python process that has imported the kernel and waits for jobs, so the import is paid
once and can be started early by `warm_up`. It is no multiprocessing child: those run the user's script
again where it lacks the `if __name__ == "__main__"` guard, and daemonic processes (dask's) may not have
any. Jobs and results travel as pickles over the worker's own pipes, never from disk.
"""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO, Literal, TypeVar

P = TypeVar("P")
R = TypeVar("R")

_START = 120.0  # seconds a worker may take to import the kernel on a busy machine
_GRACE = 10.0  # seconds after which a worker that was not stopped stops itself (its parent has died)
_PRELOAD = "sed2cad.brep.build"
_LENGTH = struct.Struct("<Q")


@dataclass(frozen=True)
class Failure:
    """A job that gave no result."""

    kind: Literal["crash", "timeout", "error"]
    sentence: str  # one clause, for a machinist


def run_isolated(job: Callable[[P], R], payload: P, timeout: float) -> R | Failure:
    """job(payload) in a worker, for at most `timeout` seconds of its time.

    `job` is a function at the top level of a module. A crash, a hang or an exception comes back as a Failure.
    """
    answer: R | Failure = asked(take(), (job, payload, timeout), lambda worker: None)
    return answer


def asked(worker: Worker, request: tuple[Any, Any, float], free: Callable[[Worker], None]) -> Any:
    """A worker's answer to (job, payload, timeout), or the Failure; free(worker) before others may take it."""
    try:
        answer = worker.ask(request, request[2])
    except BaseException:  # Ctrl-C: do not leave the job running
        free(worker)
        worker.stop()
        raise
    free(worker)
    if isinstance(answer, Failure) and answer.kind != "error":
        worker.stop()
    else:
        _give_back(worker)
    return answer


def run_alone(job: Callable[[P], R], payload: P, timeout: float) -> R | Failure:
    """job(payload) as in `run_isolated`, but in a process that does nothing else: its memory is the job's alone.

    The job may do more than ask the kernel, and may run further ones in workers of its own.
    """
    worker = Worker(alone=True)
    try:
        result: R | Failure = worker.ask((job, payload, timeout), timeout)
        return result
    finally:
        worker.stop()


def warm_up(workers: int = 1) -> None:
    """Start so many workers now, so that they have imported the kernel by the time they are needed. Returns at once.

    Where the kernel hangs a second one saves the seconds until another has started.
    """
    for _ in range(workers - len(_idle)):
        with _lock:
            _idle.insert(0, Worker())  # the last ones, which are ready, are taken first


class Worker:
    """One child process. One that is for a single job ends on Ctrl-C, also where a thread waits for it."""

    def __init__(self, alone: bool = False) -> None:
        code = f"import sys; sys.path[:] = {sys.path!r}; from sed2cad.brep.worker import serve; serve()"
        threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
        self._owner = os.getpid()
        self._ready = False
        self._name = "the process" if alone else "the CAD kernel"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **threads},
            start_new_session=not alone,
        )

    @property
    def usable(self) -> bool:
        """Whether the process is alive and was not inherited by a fork."""
        return self._owner == os.getpid() and self._process.poll() is None

    def ask(self, request: Any, timeout: float) -> Any:
        """The answer to a request; a Failure where none comes."""
        if not self._ready:
            started = self._wait(lambda: _receive(self._reader), _START)
            if isinstance(started, Failure):
                return started
            self._ready = True
        return self._wait(lambda: self._exchange(request), timeout)

    def kill(self) -> None:
        """End the process; who waits for its answer gets a Failure."""
        self._process.kill()

    def stop(self) -> None:
        """Kill the process and forget it."""
        self.kill()
        self._process.wait()
        for pipe in (self._writer, self._reader):
            with contextlib.suppress(OSError):
                pipe.close()

    @property
    def _reader(self) -> BinaryIO:
        assert self._process.stdout is not None
        return self._process.stdout  # type: ignore[return-value]

    @property
    def _writer(self) -> BinaryIO:
        assert self._process.stdin is not None
        return self._process.stdin  # type: ignore[return-value]

    def _exchange(self, request: Any) -> Any:
        _send(self._writer, request)
        return _receive(self._reader)

    def _wait(self, action: Callable[[], Any], timeout: float) -> Any:
        """action() in a thread, for at most `timeout` seconds."""
        answers: queue.Queue[Any] = queue.Queue()

        def act() -> None:
            try:
                answers.put(action())
            except (OSError, EOFError, ValueError):
                answers.put(None)

        threading.Thread(target=act, daemon=True).start()
        try:
            answer = answers.get(timeout=timeout)
        except queue.Empty:
            return Failure("timeout", f"{self._name} did not finish within {timeout:g} s")
        return self._crash() if answer is None else answer

    def _crash(self) -> Failure:
        """What ended the process."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE)
        code = self._process.returncode
        how = f"exit code {code}"
        if code is not None and code < 0:
            how = signal.Signals(-code).name
        return Failure("crash", f"{self._name} crashed ({how})")


_idle: list[Worker] = []
_lock = threading.Lock()


def take() -> Worker:
    """An idle worker, or a new one."""
    with _lock:
        while _idle:
            worker = _idle.pop()
            if worker.usable:
                return worker
    return Worker()


def _give_back(worker: Worker) -> None:
    with _lock:
        _idle.append(worker)


@atexit.register
def stop_workers() -> None:
    """Stop all idle workers, before the process ends."""
    while _idle:
        worker = _idle.pop()
        if worker.usable:
            worker.stop()


def _send(pipe: BinaryIO, message: Any) -> None:
    """Length and pickle."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.write(_LENGTH.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def _receive(pipe: BinaryIO) -> Any:
    """The next message. EOFError where the other side has gone."""
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    data = pipe.read(length)
    if len(data) < length:
        raise EOFError
    return pickle.loads(data)


def serve() -> None:
    """The worker's side: import the kernel, then do jobs until the parent goes away."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    silence = open(os.devnull, "w")  # the kernel prints
    os.dup2(silence.fileno(), sys.stdout.fileno())
    __import__(_PRELOAD)
    _send(answers, "ready")
    while True:
        try:
            job, payload, timeout = _receive(sys.stdin.buffer)
        except EOFError:
            return
        faulthandler.dump_traceback_later(timeout + _GRACE, exit=True, file=silence)
        answer = _done(job, payload)
        faulthandler.cancel_dump_traceback_later()
        _send(answers, answer)


def _done(job: Callable[[Any], Any], payload: Any) -> Any:
    """The job's result, or the Failure that its exception is."""
    from sed2cad.errors import Sed2cadError

    try:
        return job(payload)
    except Sed2cadError as error:
        return Failure("error", str(error))
    except Exception as error:
        return Failure("error", f"{type(error).__name__}: {error}".strip().splitlines()[0])
