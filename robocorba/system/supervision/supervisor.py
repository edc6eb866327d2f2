"""The supervisor that other processes call: shows the processes of a system, starts and ends robots."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NoAnswer
from pathlib import Path
from typing import TypeVar

from robocorba.errors.services import NotReachable, UnknownProcess
from robocorba.system import logs
from robocorba.system.processes import MAX_LOG_LINES, ProcessPhase, ProcessState, RobotOrder
from robocorba.system.supervision.process import Supervised
from robocorba.system.supervision.robots import Robots

#: Timeout for the event loop to carry out a call [s].
TIMEOUT_S = 3.0
Answer = TypeVar("Answer")


class Supervisor:
    """robocorba.system.processes.Processes for a system whose event loop is `loop`. For all threads but that of the
    loop.

    of_system: its processes without robots. check: completes an order or raises InvalidChoice. log_folder: of a file
    NAME.log for each process."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        of_system: Sequence[Supervised],
        robots: Robots,
        check: Callable[[RobotOrder], RobotOrder],
        log_folder: Path,
    ) -> None:
        self._loop, self._of_system, self._robots, self._check = loop, of_system, robots, check
        self._log_folder = log_folder

    def processes(self) -> list[ProcessState]:
        return self._in_loop(lambda: [state_of(process) for process in self._all()])

    def start_robot(self, order: RobotOrder) -> None:
        order = self._check(order)
        self._in_loop(lambda: self._robots.start(order))

    def end_robot(self, name: str) -> None:
        self._in_loop(lambda: self._robots.end(name))

    def log_lines(self, name: str, lines: int) -> list[str]:
        if name not in self._in_loop(lambda: {process.spec.name for process in self._all()}):
            raise UnknownProcess(name)
        return logs.last_lines(self._log_folder / f"{name}.log", min(lines, MAX_LOG_LINES))

    def _all(self) -> list[Supervised]:
        return [*self._of_system, *self._robots.processes]

    def _in_loop(self, function: Callable[[], Answer]) -> Answer:
        """The answer of a function that the event loop calls. Raises NotReachable when the system is ending."""
        answer: Future[Answer] = Future()

        def call() -> None:
            if answer.set_running_or_notify_cancel():
                try:
                    answer.set_result(function())
                except Exception as error:
                    answer.set_exception(error)

        try:
            self._loop.call_soon_threadsafe(call)
        except RuntimeError:  # the loop is closed
            raise NotReachable("the system has ended") from None
        try:
            return answer.result(TIMEOUT_S)
        except NoAnswer:
            if answer.cancel():
                raise NotReachable(f"the supervisor did not answer within {TIMEOUT_S:g} s") from None
            return answer.result()


def state_of(process: Supervised) -> ProcessState:
    """A process as others see it."""
    phases = {"waiting": ProcessPhase.STARTING, "running": ProcessPhase.READY}
    phase = phases.get(process.state) or ProcessPhase(process.state)
    return ProcessState(
        process.spec.name,
        phase,
        process.pid,
        process.restarts,
        process.started,
        process.spec.names if phase is ProcessPhase.READY else (),
        process.problem,
    )
