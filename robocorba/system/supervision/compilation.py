"""Compiles all kernels before anything needs them, once on a machine, in several processes."""

from __future__ import annotations

import contextlib
import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import psutil

from robocorba.system.kernel_store import COMPILING, KernelStore, lock, store
from robocorba.system.supervision.launch import LoggedProcess, module_command
from robocorba.system.supervision.warm_parent import ENVIRONMENT

WORKER = "robocorba.system.supervision.compile_worker"
#: Maximum number of workers: more would wait for each other.
MAX_WORKERS = 8
#: Timeout for all kernels [s]. One slow core takes 150 s.
LIMIT_S = 900.0
#: Time from SIGTERM to SIGKILL for a worker [s]. It has nothing to put in order.
GRACE_PERIOD_S = 2.0

_log = logging.getLogger(__name__)


class CompilationProgress(NamedTuple):
    """How far it is: kernels compiled, of how many, the share of the work that is done, and about how long the rest
    takes [s], None while nobody knows."""

    done: int
    of: int
    share: float
    seconds_left: float | None


class Progress:
    """Counts what is compiled. expected: how long each missing kernel takes on a core of its own [s]."""

    def __init__(
        self, expected: Mapping[str, float], workers: int = 1, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._expected, self._workers, self._clock = expected, workers, clock
        #: When the first worker began; until then they only load the compiler.
        self._began: float | None = None
        #: How long each kernel took, all its signatures together [s].
        self.seconds: dict[str, float] = {}

    def read(self, line: str) -> None:
        """A worker has printed a line: `ready`, or a kernel and the time that a signature of it took [s]."""
        name, _, seconds = line.strip().rpartition(" ")
        if not name:
            self._began = self._clock() if self._began is None else self._began
            return
        with contextlib.suppress(ValueError):  # some library has printed it
            self.seconds[name] = self.seconds.get(name, 0.0) + float(seconds)

    @property
    def now(self) -> CompilationProgress:
        done = self._expected.keys() & self.seconds.keys()
        total = sum(self._expected.values())
        share = sum(self._expected[name] for name in done) / total if total else 1.0
        left = None
        if self._began is not None:
            elapsed = self._clock() - self._began
            # After a tenth of the work its pace counts as much as the expected one: one kernel alone says little.
            left = (elapsed + 0.1 * total / self._workers) / (share + 0.1) * (1.0 - share)
        return CompilationProgress(len(done), len(self._expected), share, left)


def compile_kernels(
    report: Callable[[CompilationProgress], None], logs: Path, kernels: KernelStore | None = None
) -> bool:
    """Compile what this machine has not compiled yet, in as many processes as are worth while; their logs go to a
    folder. Calls `report` some times a second. To be called in the main thread.

    Returns whether all are compiled; else the log says why, and processes compile the others when they need them."""
    kernels = kernels or store()
    if kernels.is_complete or not kernels.folder:
        return bool(kernels.folder)
    with lock(kernels.folder / COMPILING, LIMIT_S):
        if kernels.is_complete:  # another process has compiled them meanwhile
            return True
        expected = kernels.expected_seconds()
        missing = {name: expected[name] for name in kernels.missing}
        workers = worker_count(len(missing))
        progress = Progress(missing, workers)
        if missing and not _compile(progress, workers, report, logs):
            return False
        kernels.set_complete(progress.seconds)
        return True


def worker_count(kernels: int) -> int:
    """The number of workers for a number of kernels: one for each core, as far as there is memory and work for them."""
    cores = len(os.sched_getaffinity(0))
    memory = psutil.virtual_memory().available // 600_000_000  # bytes that a worker takes
    return max(1, min(cores, memory, kernels, MAX_WORKERS))


def _compile(progress: Progress, count: int, report: Callable[[CompilationProgress], None], logs: Path) -> bool:
    """Whether all workers have ended well."""
    deadline = time.monotonic() + LIMIT_S
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-compile-"))
        command = ("env", *ENVIRONMENT, *module_command(WORKER, folder))
        workers = [
            stack.enter_context(
                LoggedProcess(logs / f"compile_{number}.log", *command, cwd="/", grace_period_s=GRACE_PERIOD_S)
            )
            for number in range(count)
        ]
        report(progress.now)
        for lines in _output(workers):
            for line in lines:
                progress.read(line)
            report(progress.now)
            if time.monotonic() > deadline:
                _log.error("the kernels are not compiled after %.0f s; servers compile the others", LIMIT_S)
                return False
        failed = [worker for worker in workers if not _ended_well(worker)]
        return not failed


def _output(workers: Sequence[LoggedProcess]) -> Iterator[list[str]]:
    """What the workers print, some times a second, until all have ended."""
    running = list(workers)
    while running:
        lines = []
        for worker in list(running):
            with contextlib.suppress(TimeoutError):
                while line := worker.read_line(0.05):
                    lines.append(line)
                running.remove(worker)
        yield lines


def _ended_well(worker: LoggedProcess) -> bool:
    code = worker.wait(GRACE_PERIOD_S)
    if code:
        last = worker.log_tail().strip().rpartition("\n")[2]
        _log.error("a process that compiled kernels ended with exit code %d (%s); see %s", code, last, worker.log)
    return code == 0
