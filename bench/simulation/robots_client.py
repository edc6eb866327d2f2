"""Many robots in processes of their own, which log on and drive. Times are of CLOCK_MONOTONIC."""

from __future__ import annotations

import contextlib
import math
import random
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from omniORB import CORBA

from robocorba.clients.robot_processes import servers
from robocorba.orb.orb import Orb
from robocorba.simulation.corba import sessions
from robocorba.simulation.registry import Description
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import ScanSpec
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address
from testkit.generated_buildings import saved_office
from testkit.json_process import LoggedOff, ObjectProcess, checked_call
from testkit.report import timed_ms

T = TypeVar("T")
START_LIMIT_S = 60.0
#: Validity of a command [s].
VALID_S = 0.5
#: Interval between heartbeats of idle robots [s].
HEARTBEAT_INTERVAL_S = 0.8
#: Velocity ahead, left [m/s] and turn [rad/s] of a driving robot, and of one that turns away.
ON, AWAY = (0.7, 0.0, 0.2), (0.0, 0.0, 1.2)
#: Speed below which a robot is stuck [m/s].
STUCK_M_S = 0.1
#: Commands after a turn during which a robot does not count as stuck.
PATIENCE = 6
FULL = ScanSpec(Fan(-math.pi, 2 * math.pi / 360, 360, 30.0))
NO_MOUNT = RoboCorba.Mount(0.0, 0.0, 0.0)


class Robot:
    """A logged-on robot that wanders."""

    def __init__(self, session: Any, number: int) -> None:
        self.session = session
        self._chance = random.Random(number)
        #: Commands left of its turn; negative: commands since its turn.
        self._turning = 0

    def next_command(self) -> tuple[float, float, float]:
        """Velocity ahead, left [m/s] and turn [rad/s]."""
        return AWAY if self._turning > 0 else ON

    def look(self, speed: float) -> None:
        """Record the speed after a command [m/s]; a stuck robot starts a turn."""
        self._turning -= 1
        if self._turning < -PATIENCE and speed < STUCK_M_S:
            self._turning = self._chance.randint(5, 20)


class Fleet:
    """The robots of this process. All methods but `close` return an answer, with times in ms."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._robots: list[Robot] = []
        self._idle: list[Robot] = []
        self._heartbeats = Repeating("beats", self._heartbeat, HEARTBEAT_INTERVAL_S).start()

    def log_on(self, robots: Sequence[Description], count: int) -> dict[str, Any]:
        """Log `count` of the robots on, one after the other; skip a robot whose place is taken by a pushed object."""
        took: list[float] = []
        for about in robots:
            if len(took) == count:
                break
            with contextlib.suppress(RoboCorba.PlaceTaken):
                session, ms = timed_ms(self._server.registerRobot, sessions.description(about))
                took.append(ms)
                self._robots.append(Robot(session, len(self._robots)))
                self._idle.append(self._robots[-1])
        return {"log on": took}

    def log_off(self) -> dict[str, Any]:
        """Log all robots off."""
        took = []
        with self._without_heartbeats():
            for robot in self._robots:
                with contextlib.suppress(LoggedOff):
                    took.append(timed_ms(checked_call, robot.session.deregister)[1])
            self._robots = []
        return {"log off": took}

    def drive(self, begin: float, seconds: float, rate: float, threads: int) -> dict[str, Any]:
        """Command each robot and read its state `rate` times a second, evenly spread, from time `begin` on.

        late: delay of each command after its due time. lost: robots whose lease expired. cpu: CPU load of this process,
        as a share of a core."""
        offset_s = 1 / rate / len(self._robots)
        with self._without_heartbeats():
            found, cpu = self._in_threads(
                threads, lambda part, thread: drive(part, begin + thread * offset_s, seconds, rate)
            )
        return {**joined(found), "cpu": cpu}

    def close(self) -> None:
        self._heartbeats.close()

    def _in_threads(self, threads: int, work: Callable[[list[Robot], int], T]) -> tuple[list[T], float]:
        """The results of the threads with a part of the robots each, and the CPU load of this process."""
        began, worked = time.monotonic(), time.process_time()
        with ThreadPoolExecutor(threads) as pool:
            found = list(pool.map(lambda thread: work(self._robots[thread::threads], thread), range(threads)))
        return found, (time.process_time() - worked) / (time.monotonic() - began)

    def _heartbeat(self) -> None:
        for robot in list(self._idle):
            if not self._idle:
                return
            with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):  # it is logging off
                robot.session.heartbeat()

    @contextlib.contextmanager
    def _without_heartbeats(self) -> Iterator[None]:
        """Suspend the heartbeats while the robots make calls."""
        self._idle = []
        try:
            yield
        finally:
            self._idle = list(self._robots)


def drive(robots: Sequence[Robot], begin: float, seconds: float, rate: float) -> dict[str, Any]:
    """Drive the robots of one thread; late commands catch up, commands after the end are omitted."""
    found: dict[str, list[float]] = {"command": [], "state": [], "late": []}
    lost: set[Robot] = set()
    due_in_all = round(seconds * rate * len(robots))
    for number in range(due_in_all):
        due = begin + number / rate / len(robots)
        time.sleep(max(0.0, due - time.monotonic()))
        began = time.monotonic()
        if began > begin + seconds:
            break
        robot = robots[number % len(robots)]
        if robot in lost:
            continue
        try:
            _, ms = timed_ms(checked_call, robot.session.command, RoboCorba.Velocity(*robot.next_command()), VALID_S)
            state, ms_state = timed_ms(checked_call, robot.session.state)
        except LoggedOff:
            lost.add(robot)
            continue
        robot.look(math.hypot(state.moving.ahead, state.moving.left))
        for times, value in zip(found.values(), (ms, ms_state, (began - due) * 1e3), strict=True):
            times.append(round(value, 4))
    return {**found, "due": due_in_all, "lost": len(lost)}


def joined(answers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Answers with the same keys as one: lists are concatenated, numbers added."""
    return {
        what: sum((answer[what] for answer in answers), start=[] if isinstance(value, list) else 0)
        for what, value in answers[0].items()
    }


# ---- interface for the benches ----


@contextlib.contextmanager
def fleet(naming: Address) -> Iterator[Fleet]:
    with Orb(naming) as orb:
        found = Fleet(orb.resolve("SimulationServer", RoboCorba.SimulationServer, START_LIMIT_S))
        with contextlib.closing(found):
            yield found


class Clients(contextlib.ExitStack):
    """Fleets in processes of their own."""

    def __init__(self, naming: Address, count: int) -> None:
        super().__init__()
        self._fleets = [ObjectProcess(fleet, naming) for _ in range(count)]  # they start side by side
        for each in self._fleets:
            self.enter_context(each)

    def log_on(self, robots: Sequence[Description], count: int, at_once: bool = True) -> dict[str, Any]:
        """Log on the first `count` robots whose place is free, spread over the processes.

        at_once: the processes work simultaneously, else one after the other."""
        processes = len(self._fleets)
        shares = [
            (list(robots[number::processes]), len(range(number, count, processes))) for number in range(processes)
        ]
        return self._ask("log_on", shares, at_once)

    def all(self, do: str, *arguments: Any) -> dict[str, Any]:
        """Execute a command in all processes simultaneously; answers with lists joined and numbers added."""
        return self._ask(do, [arguments] * len(self._fleets))

    def _ask(self, do: str, arguments: Sequence[tuple[Any, ...]], at_once: bool = True) -> dict[str, Any]:
        pairs = list(zip(self._fleets, arguments, strict=True))
        if not at_once:
            return joined([each.call(do, *values) for each, values in pairs])
        for each, values in pairs:
            each.send(do, *values)
        return joined([each.receive() for each in self._fleets])


@contextlib.contextmanager
def office_system(folder: Path, *more: str) -> Iterator[tuple[Address, Orb, Any]]:
    """`robocorba up` on the office with its state in folder/state: naming service, ORB, simulation server."""
    with servers(folder / "state", "--building", str(saved_office(folder)), *more) as naming, Orb(naming) as orb:
        yield naming, orb, orb.resolve("SimulationServer", RoboCorba.SimulationServer)
