"""Robots that are started and ended on order, as processes of a system."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robocorba.errors.services import ProcessExists, UnknownProcess
from robocorba.errors.simulation import InvalidChoice
from robocorba.orb.orb import CONTEXT
from robocorba.system.names import ROBOTS
from robocorba.system.processes import RobotOrder, RobotProgress
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import ModuleRun
from robocorba.system.supervision.output import READY, ReadyLine
from robocorba.system.supervision.process import GRACE_PERIOD_S, ProcessSpec, Supervised
from robocorba.system.supervision.starter import Starter

#: Maximum number of robots that a system has started, those that have ended included.
MAX_ROBOTS = 200
#: Number of robots that start at a time.
STARTING = 2 * (os.cpu_count() or 1)

_log = logging.getLogger(__name__)


def robot_spec(
    order: RobotOrder,
    state: Path,
    naming: Address,
    start_limit_s: float,
    progress: ProgressLines | None = None,
    grace_period_s: float = GRACE_PERIOD_S,
) -> ProcessSpec:
    """The process of a robot. It is ready when it says so: its name may still be bound by a former robot.

    progress: receives what the process prints, with lines about the robot's progress."""
    # With = no value can be taken for an option.
    options = [f"--adaptor={order.adaptor}", f"--naming={naming.setting}", f"--state={state}"]
    given = ("floor", order.floor), ("channel", order.channel), ("program", order.program), ("perceive", order.perceive)
    options += [f"--{option}={value}" for option, value in given if value]
    if order.at is not None:
        options.append("--at=" + ",".join(map(repr, order.at)))
    if progress is not None:
        options.append("--progress")
    command = ModuleRun("robocorba.clients.robot", (order.name, *options, "--", *order.adaptor_arguments))
    output = progress or ReadyLine(order.process)
    return ProcessSpec(
        order.process,
        command,
        state,
        output.probe,
        output,
        start_limit_s=start_limit_s,
        names=(f"{CONTEXT}/{ROBOTS}/{order.name}",),
        grace_period_s=grace_period_s,
    )


class ProgressLines(ReadyLine):
    """Also receives a robot's progress, and calls `changed` after each change."""

    def __init__(self, name: str, changed: Callable[[], None]) -> None:
        super().__init__(name)
        self._changed = changed
        self.progress = RobotProgress()

    def __call__(self, line: str) -> None:
        progress = RobotProgress.read(line)
        if line == READY:
            self.progress = RobotProgress()
        if progress is None:
            super().__call__(line)
        else:
            self.progress = progress
            self._changed()


@dataclass
class _Robot:
    process: Supervised
    task: asyncio.Task[None]
    is_stopping: bool = False


class Robots:
    """The robots of a system. To be used in the thread of the event loop, which must be the main one.

    spec_of: the process for an order. changed: called whenever a state has changed. starting: maximum number of robots
    that start at a time, so that all of them start in time. restarts: whether robots that end are started again."""

    def __init__(
        self,
        spec_of: Callable[[RobotOrder], ProcessSpec],
        starter: Starter,
        changed: Callable[[], None],
        starting: int = STARTING,
        restarts: bool = False,
    ) -> None:
        self._spec_of, self._starter, self._changed = spec_of, starter, changed
        self._turns, self._restarts = asyncio.Semaphore(starting), restarts
        self._robots: dict[str, _Robot] = {}

    @property
    def processes(self) -> list[Supervised]:
        """In the order of their starts; those that have ended by themselves stay until `end` or a new start."""
        return [robot.process for robot in self._robots.values()]

    def start(self, order: RobotOrder) -> Supervised:
        """Start a robot as soon as it is its turn. Raises ProcessExists, InvalidChoice."""
        former = self._robots.get(order.name)
        if former is not None and not former.task.done():
            raise ProcessExists(order.name)
        if former is None and len(self._robots) >= MAX_ROBOTS:
            raise InvalidChoice("name", f"this system has started {MAX_ROBOTS} robots, its limit; end one of them")
        self._robots.pop(order.name, None)
        process = Supervised(self._spec_of(order), self._starter, changed=self._changed, turns=self._turns)
        run = process.supervise() if self._restarts else process.run()
        robot = self._robots[order.name] = _Robot(process, asyncio.create_task(run))
        robot.task.add_done_callback(lambda task: self._ended(order.name, robot))
        self._changed()
        return process

    def end(self, name: str) -> None:
        """Begin to end a robot, or forget one that has ended. Raises UnknownProcess."""
        known = {robot.process.spec.name: key for key, robot in self._robots.items()}
        key = name if name in self._robots else known.get(name)
        if key is None:
            raise UnknownProcess(name)
        if self._robots[key].task.done():
            del self._robots[key]
            self._changed()
        else:
            self._stop(self._robots[key])

    async def close(self) -> None:
        """End all robots."""
        robots = list(self._robots.values())
        for robot in robots:
            self._stop(robot)
        for robot in robots:
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await robot.task

    def _stop(self, robot: _Robot) -> None:
        if not robot.is_stopping:  # a second cancellation would end it without its time to log off
            robot.is_stopping = True
            robot.task.cancel()

    def _ended(self, name: str, robot: _Robot) -> None:
        process = robot.process
        if robot.is_stopping or robot.task.cancelled():
            if self._robots.get(name) is robot:
                del self._robots[name]
            self._changed()
            return
        if error := robot.task.exception():
            process.problem = str(error)
            _log.error("%s", error)
        process.set_state("ended", pid=0)
