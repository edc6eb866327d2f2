"""Compiles all kernels before anything needs them, once on a machine, in one process that all others wait for."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from robocorba.system.kernel_store import KernelStore, lock, store
from robocorba.system.supervision.launch import LoggedProcess, module_command
from robocorba.system.supervision.warm_parent import ENVIRONMENT

WORKER = "robocorba.system.supervision.compile_worker"
#: Timeout for all kernels [s]. One slow core takes 100 s.
LIMIT_S = 900.0
#: Share of the work after which its pace tells how long the rest takes: the first kernels alone say little.
MIN_SHARE = 0.1
#: Interval between reports [s].
_INTERVAL_S = 0.1

_log = logging.getLogger(__name__)


class Progress:
    """How many kernels are compiled. sizes: of those to be compiled, in any unit."""

    def __init__(self, sizes: Mapping[str, int], clock: Callable[[], float] = time.monotonic) -> None:
        self._sizes, self._clock = sizes, clock
        self._began, self._compiled = clock(), set[str]()

    def add(self, name: str) -> None:
        """A kernel is compiled, perhaps for another signature."""
        self._compiled |= {name} & self._sizes.keys()

    @property
    def share(self) -> float:
        """Share of the work that is done."""
        total = sum(self._sizes.values())
        return sum(self._sizes[name] for name in self._compiled) / total if total else 1.0

    def __str__(self) -> str:
        """Such as "45 of 136, about 20 s left"."""
        text, share = f"{len(self._compiled)} of {len(self._sizes)}", self.share
        if share < MIN_SHARE:
            return text
        left_s = (self._clock() - self._began) * (1.0 - share) / share
        return f"{text}, about {max(left_s, 1.0):.0f} s left"


def compile_kernels(report: Callable[[Progress], None], logs: Path, kernels: KernelStore | None = None) -> bool:
    """Compile what this machine has not compiled yet, in a process whose log goes to a folder; or wait until another
    one has. Calls `report` some times a second. To be called in the main thread.

    Returns whether all are compiled; else the log says why, and processes compile the others when they need them."""
    kernels = kernels or store()
    if kernels.is_complete or not kernels.folder:
        return bool(kernels.folder)
    with lock(kernels.folder.parent / "compiling.lock", LIMIT_S):
        if kernels.is_complete:  # another process has compiled them meanwhile
            return True
        command = ("env", *ENVIRONMENT, *module_command(WORKER))
        # It has nothing to put in order when it is told to end.
        with LoggedProcess(logs / "compile.log", *command, cwd="/", grace_period_s=2.0) as worker:
            is_done = _wait(worker, Progress(kernels.missing), report)
        if is_done:
            kernels.set_complete()
        return is_done


def _wait(worker: LoggedProcess, progress: Progress, report: Callable[[Progress], None]) -> bool:
    """Whether the process ends well, in time."""
    deadline = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline:
        report(progress)
        with contextlib.suppress(TimeoutError):
            while line := worker.read_line(_INTERVAL_S):
                progress.add(line.strip())
            report(progress)
            if code := worker.wait(LIMIT_S):
                last = worker.log_tail().strip().rpartition("\n")[2]
                _log.error("the process that compiles kernels ended: exit code %d (%s); see %s", code, last, worker.log)
            return code == 0
    _log.error("the kernels are not compiled after %.0f s; servers compile the others", LIMIT_S)
    return False
