"""Compiles all kernels before anything needs them, once on a machine, by one process that all others wait for."""

from __future__ import annotations

import contextlib
import logging
import subprocess
import time
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from robocorba.system.kernel_store import KernelStore, lock, store
from robocorba.system.supervision.launch import LoggedProcess, module_command
from robocorba.system.supervision.warm_parent import ENVIRONMENT

WORKER = "robocorba.system.supervision.compile_worker"
#: Timeout for all kernels [s]. One slow core takes 120 s.
LIMIT_S = 900.0
#: Share of the work after which its pace shows how long the rest takes: the first kernels alone say little.
MIN_SHARE = 0.1
#: Interval between reports [s].
_INTERVAL_S = 0.1

_log = logging.getLogger(__name__)


class Progress:
    """How many kernels are compiled. sizes: of those to be compiled, in any unit."""

    def __init__(self, sizes: Mapping[str, int], clock: Callable[[], float] = time.monotonic) -> None:
        self._sizes, self._clock = sizes, clock
        self._began, self._compiled = clock(), set[str]()

    def update(self, missing: Collection[str]) -> None:
        """These are not compiled yet."""
        self._compiled = self._sizes.keys() - missing

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
    progress = Progress(kernels.missing)

    def report_progress() -> None:
        progress.update(kernels.missing)
        report(progress)

    with lock(kernels.folder.parent / "compiling.lock", LIMIT_S, _INTERVAL_S, report_progress):
        if kernels.is_complete:  # another process has compiled them meanwhile
            return True
        command = ("env", *ENVIRONMENT, *module_command(WORKER))
        # It has nothing to put in order when it is told to end.
        with LoggedProcess(logs / "compile.log", *command, cwd="/", grace_period_s=2.0) as worker:
            if not _ends_well(worker, report_progress):
                return False
        if missing := kernels.missing:  # the disk is full
            _log.error("%d compiled kernels can't be kept in %s; see %s", len(missing), kernels.folder, worker.log)
            return False
        kernels.set_complete()
        return True


def _ends_well(worker: LoggedProcess, report_progress: Callable[[], None]) -> bool:
    """Whether the process ends without an error, in time."""
    deadline = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline:
        report_progress()
        with contextlib.suppress(subprocess.TimeoutExpired):
            if code := worker.wait(_INTERVAL_S):
                last = worker.log_tail().strip().rpartition("\n")[2]
                _log.error("the process that compiles kernels ended: exit code %d (%s); see %s", code, last, worker.log)
            return code == 0
    _log.error("the kernels are not compiled after %.0f s; servers compile the others", LIMIT_S)
    return False
