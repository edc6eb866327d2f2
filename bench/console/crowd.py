"""A crowd for viewers: robots that drive in circles, some with lasers and arms, and the simulation's clock."""

from __future__ import annotations

import contextlib
import itertools
import math
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from bench.simulation.robots_client import Clients
from robocorba.clients.robot_processes import servers
from robocorba.orb.naming import Address
from robocorba.orb.orb import Orb
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.corba import sessions
from robocorba.simulation.registry import Description
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.generated_buildings import office, saved_office
from testkit.generated_buildings import robots as robots_in

FLOOR = "L1"
LASERS, ARMS = 8, 3
#: Rate of commands, scans and postures of each robot [1/s].
RATE = 10.0
#: Interval at which simulated time is sampled [s].
SAMPLE_S = 0.02
NO_MOUNT = RoboCorba.Mount(0.0, 0.0, 0.0)


class Crowd:
    """Robots of this process: each drives in circles and scans, the first ones move their arms."""

    def __init__(self, server: Any, robots: Sequence[Description]) -> None:
        self._sessions = [server.registerRobot(sessions.description(about)) for about in robots]
        self._tasks = [
            Repeating(f"robot {number}", self._task(number, session), 1 / RATE).start()
            for number, session in enumerate(self._sessions)
        ]

    def close(self) -> None:
        for task in self._tasks:
            task.close()

    @staticmethod
    def _task(number: int, session: Any) -> Any:
        sensor = session._get_sensor()
        laser, ticks = sensor.laser(), itertools.count()

        def tick() -> None:
            session.command(RoboCorba.Velocity(0.3, 0.0, 0.5), 0.5)
            sensor.scan(session.state().at, NO_MOUNT, laser)
            if number < ARMS:
                session.reportPosture([0.3 * math.sin(next(ticks) / 5 + joint) for joint in range(len(JOINTS))])

        return tick


class Clock:
    """When the simulation reached which simulated time [s], sampled in the background."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self.samples: list[tuple[float, float]] = []
        self._task = Repeating("clock", self._sample, SAMPLE_S).start()

    def _sample(self) -> None:
        simulated = self._server._get_state().time
        self.samples.append((simulated, time.time()))

    def at(self, simulated: Sequence[float]) -> np.ndarray:
        """POSIX times of simulated times [s]."""
        times, walls = zip(*self.samples, strict=True)
        return np.interp(simulated, times, walls)

    def pace(self, since: int) -> float:
        """Simulated seconds per second since a sample."""
        (first, began), (last, ended) = self.samples[since], self.samples[-1]
        return (last - first) / (ended - began)

    def close(self) -> None:
        self._task.close()


@contextlib.contextmanager
def crowded_system(folder: Path, count: int, *options: str) -> Iterator[tuple[Address, Clock, Orb]]:
    """Servers, started with these options of `robocorba up`, beside `count` driving robots: the address of the naming
    service, the simulation's clock, and this process's ORB."""
    building = saved_office(folder)
    crowd = [about for about in robots_in(office(), 6 * count) if about.pose.floor == FLOOR][:count]
    with (
        servers(folder, "--building", str(building), *options) as naming,
        Orb(naming) as orb,
        Clients(naming, 1) as clients,
    ):
        server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        clients.log_on(crowd[LASERS:], count - LASERS)
        ended = threading.Event()

        def drive() -> None:
            while not ended.is_set():
                clients.all("drive", time.monotonic(), 5.0, RATE, 4)

        with (
            ThreadPoolExecutor(1) as driver,
            contextlib.closing(Crowd(server, crowd[:LASERS])),
            contextlib.closing(Clock(server)) as clock,
        ):
            driving = driver.submit(drive)
            try:
                yield naming, clock, orb
            finally:
                ended.set()
                driving.result()
