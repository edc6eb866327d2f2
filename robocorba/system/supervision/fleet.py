"""A fleet: many robots, each a process of its own, started, shown and ended together."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.registered_robots import floors_of_robots
from robocorba.system.processes import RobotOrder
from robocorba.system.settings import Settings
from robocorba.system.supervision.process import GRACE_PERIOD_S, ProcessSpec, Supervised
from robocorba.system.supervision.robots import ProgressLines, Robots, robot_spec
from robocorba.system.supervision.starter import Starter


class Row(NamedTuple):
    """A robot as it is shown. doing: queued or starting; working, waiting or exceptional; or ended. task: its present
    or last program or mission. note: what its touch panel shows and how the task ended, or why the robot has ended."""

    name: str
    floor: str
    doing: str
    task: str
    restarts: int
    note: str


class View(Protocol):
    """Shows a fleet. All robots are in each call, in their order."""

    def show(self, rows: Sequence[Row]) -> None: ...

    def started(self) -> None:
        """All robots have started, or ended."""

    def end(self, robots: int, running: int) -> None:
        """All robots end; `running` of them still run."""


class Fleet:
    """orders: the robots. settings: state folder and naming service of all of them. starting: maximum number of robots
    that start at a time. restarts: whether robots that end are started again. start_limit_s: timeout for a robot to be
    ready [s]."""

    def __init__(
        self,
        orders: Sequence[RobotOrder],
        settings: Settings,
        view: View,
        starting: int,
        restarts: bool,
        start_limit_s: float,
    ) -> None:
        self._orders, self._settings, self._view = orders, settings, view
        self._starting, self._restarts, self._start_limit_s = starting, restarts, start_limit_s
        self._processes: dict[str, Supervised] = {}
        self._lines: dict[str, ProgressLines] = {}
        self._floors: Mapping[str, str] = {}
        #: Set when a row may have changed; made in the event loop.
        self._changed: asyncio.Event

    def run(self, orb: Orb) -> bool:
        """Run until a signal, or until all robots have ended. Returns whether all robots ran until the signal."""
        return asyncio.run(self._run(floors_of_robots(orb)))

    async def _run(self, read_floors: Callable[[], Mapping[str, str]]) -> bool:
        stop, self._changed = asyncio.Event(), asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        starter = Starter()
        robots = Robots(self._spec, starter, self._changed.set, self._starting, self._restarts)
        tasks: list[asyncio.Task[object]] = []
        try:
            for order in self._orders:
                self._processes[order.name] = robots.start(order)
            tasks = [asyncio.create_task(self._follow()), asyncio.create_task(stop.wait())]
            tasks.append(asyncio.create_task(self._watch_floors(read_floors)))
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
            return not any(process.state == "ended" for process in self._processes.values())
        finally:
            await self._end(robots, tasks)
            await starter.close()

    async def _end(self, robots: Robots, tasks: Sequence[asyncio.Task[object]]) -> None:
        for task in tasks:
            task.cancel()
        ending = asyncio.create_task(robots.close())
        while not ending.done():
            self._view.end(len(self._orders), sum(process.pid != 0 for process in robots.processes))
            await asyncio.wait({ending}, timeout=0.5)
        ending.result()
        self._view.end(len(self._orders), 0)

    async def _follow(self) -> None:
        """Show what changes, until all robots have ended."""
        processes, is_started = list(self._processes.values()), False
        while True:
            self._changed.clear()
            self._view.show(self.rows())
            if not is_started and all(each.ready.is_set() or each.state == "ended" for each in processes):
                is_started = True
                self._view.started()
            if all(each.state == "ended" for each in processes):
                return
            await asyncio.sleep(0.25)  # between two views at least
            await self._changed.wait()

    async def _watch_floors(self, read_floors: Callable[[], Mapping[str, str]]) -> None:
        while True:
            with contextlib.suppress(NotReachable):  # the last ones stay
                floors = await asyncio.to_thread(read_floors)
                if floors != self._floors:
                    self._floors = floors
                    self._changed.set()
            await asyncio.sleep(2.0)

    def _spec(self, order: RobotOrder) -> ProcessSpec:
        lines = self._lines[order.name] = ProgressLines(order.process, self._changed.set)
        grace_period_s = GRACE_PERIOD_S + 0.2 * len(self._orders)  # they log off all together
        settings = self._settings
        return robot_spec(order, settings.state, settings.naming, self._start_limit_s, lines, grace_period_s)

    def rows(self) -> list[Row]:
        """The robots in their order."""
        return [
            row_of(order, self._processes[order.name], self._lines[order.name], self._floors.get(order.name, ""))
            for order in self._orders
        ]


def row_of(order: RobotOrder, process: Supervised, lines: ProgressLines, floor: str) -> Row:
    """A robot with its floor; a robot that is not logged on yet has that of its order."""
    floor = floor or order.floor
    if process.state != "running":
        problem = process.problem.removeprefix(f"{order.process} ")
        doing = "queued" if process.state == "waiting" else process.state
        return Row(order.name, floor, doing, "", process.restarts, problem)
    progress = lines.progress
    note = "; ".join(filter(None, (progress.text, progress.result)))
    return Row(order.name, floor, progress.kind, progress.task, process.restarts, note)
