"""Many robots in processes of their own, which log on and drive. Times are of CLOCK_MONOTONIC."""

from __future__ import annotations

import contextlib
import itertools
import math
import random
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from robocorba.orb.orb import Orb
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.corba import sessions
from robocorba.simulation.registry import Description
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import ScanSpec
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.heartbeats import heartbeats
from testkit.json_process import LoggedOff, ObjectProcess, checked_call
from testkit.report import timed_ms

START_LIMIT_S = 60.0
#: Validity of a command [s].
VALID_S = 0.5
#: Velocity ahead, left [m/s] and turn [rad/s] of a driving robot, and of one that turns away.
ON, AWAY = (0.7, 0.0, 0.2), (0.0, 0.0, 1.2)
#: Speed below which a robot is stuck [m/s].
STUCK_M_S = 0.1
#: Commands after a turn during which a robot does not count as stuck.
PATIENCE = 6
FULL = ScanSpec(Fan(-math.pi, 2 * math.pi / 360, 360, 30.0))
NO_MOUNT = RoboCorba.Mount(0.0, 0.0, 0.0)


class Robot:
    """A logged-on robot that wanders. senses: it also scans and moves its arms at each command."""

    def __init__(self, session: Any, number: int, senses: bool) -> None:
        self.session = session
        self._chance = random.Random(number)
        #: Commands left of its turn; negative: commands since its turn.
        self._turning = 0
        self._sensor = session._get_sensor() if senses else None
        self._laser, self._ticks = self._sensor.laser() if senses else None, itertools.count()

    def drive(self) -> tuple[float, float]:
        """Command it and read its state; the durations of both calls [ms]. A stuck robot starts a turn."""
        velocity = RoboCorba.Velocity(*(AWAY if self._turning > 0 else ON))
        _, command_ms = timed_ms(checked_call, self.session.command, velocity, VALID_S)
        state, state_ms = timed_ms(checked_call, self.session.state)
        self._turning -= 1
        if self._turning < -PATIENCE and math.hypot(state.moving.ahead, state.moving.left) < STUCK_M_S:
            self._turning = self._chance.randint(5, 20)
        if self._sensor:
            with contextlib.suppress(RoboCorba.SensorBehind):  # on a busy machine
                self._sensor.scan(state.at, NO_MOUNT, self._laser)
            self.session.reportPosture([0.3 * math.sin(next(self._ticks) / 5 + joint) for joint in range(len(JOINTS))])
        return command_ms, state_ms


class Fleet:
    """The robots of this process. All methods but `close` return an answer, with times in ms."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._robots: list[Robot] = []
        self._is_driving = False
        self.close = heartbeats(lambda: [robot.session for robot in self._robots if not self._is_driving]).close

    def log_on(self, robots: Sequence[Description], count: int, sensing: int = 0) -> dict[str, Any]:
        """Log `count` of the robots on, one after the other, of which the first ones sense; skip a robot whose place is
        taken by a pushed object."""
        took: list[float] = []
        for about in itertools.takewhile(lambda _: len(took) < count, robots):
            with contextlib.suppress(RoboCorba.PlaceTaken):
                session, ms = timed_ms(self._server.registerRobot, sessions.description(about))
                took.append(ms)
                self._robots.append(Robot(session, len(self._robots), len(self._robots) < sensing))
        return {"log on": took}

    def log_off(self) -> dict[str, Any]:
        """Log all robots off."""
        robots, self._robots = self._robots, []
        for robot in robots:
            with contextlib.suppress(LoggedOff):
                checked_call(robot.session.deregister)
        return {}

    def drive(self, begin: float, seconds: float, rate: float, threads: int) -> dict[str, Any]:
        """Command each robot and read its state `rate` times a second, evenly spread, from time `begin` on.

        late: delay of each command after its due time. lost: robots whose lease expired. cpu: CPU load of this process,
        as a share of a core."""
        began, worked, self._is_driving = time.monotonic(), time.process_time(), True
        offset_s = 1 / rate / len(self._robots)
        with ThreadPoolExecutor(threads) as pool:
            parts = [self._robots[thread::threads] for thread in range(threads)]
            begins = [begin + thread * offset_s for thread in range(threads)]
            found = list(pool.map(partial(drive, seconds=seconds, rate=rate), parts, begins))
        self._is_driving = False
        return {**joined(found), "cpu": (time.process_time() - worked) / (time.monotonic() - began)}


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
            took = robot.drive()
        except LoggedOff:
            lost.add(robot)
            continue
        for times, value in zip(found.values(), (*took, (began - due) * 1e3), strict=True):
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

    def log_on(self, robots: Sequence[Description], count: int, sensing: int = 0) -> list[float]:
        """Log on the first `count` robots whose place is free, spread over the processes, one after the other; the
        durations [ms]."""
        found: list[float] = []
        for number, each in enumerate(self._fleets):
            share = len(range(number, count, len(self._fleets)))
            found += each.call("log_on", list(robots[number :: len(self._fleets)]), share, sensing)["log on"]
        return found

    def all(self, do: str, *arguments: Any) -> dict[str, Any]:
        """Execute a command in all processes simultaneously; answers with lists joined and numbers added."""
        for each in self._fleets:
            each.send(do, *arguments)
        return joined([each.receive() for each in self._fleets])
