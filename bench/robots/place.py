"""Real processes for benches with one robot: servers, the actual robot's stand-in, a recorded robot process."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.processes import Process
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.errors.services import NotReachable
from robocorba.maps import native
from robocorba.settings import Address
from robocorba.spatial.grids import Floats
from robocorba.stubs import RoboCorba
from robocorba.supervision.system import naming_service_command
from robocorba.testing.buildings import two_floors
from robocorba.testing.processes import Launcher, Running, claimed_ports, eventually, real_system

START_LIMIT_S = 300.0
NAME, FLOOR = "A", "L1"


@contextlib.contextmanager
def servers(folder: Path) -> Iterator[Running]:
    """`robocorba up` on two floors of 20 x 10 m."""
    native.save(two_floors(), folder / "two-floors.yaml")
    with claimed_ports() as port, Launcher(folder) as launch:
        running = real_system(launch, folder / "state", port, "--building", "two-floors.yaml", "--subnets", "main")
        yield running.wait_ready()


@contextlib.contextmanager
def stand_in(folder: Path, orb: Orb, host: str = "127.0.0.1", within: Sequence[str] = ()) -> Iterator[Address]:
    """Runs the naming service of an actual robot and servers/smartpal; yields the naming service's address. within:
    command prefix that runs them elsewhere."""
    names = folder / "robot-names"
    names.mkdir()
    with claimed_ports() as port:
        naming = Address(host, port)
        own_naming = (*within, *naming_service_command(naming, names))
        robot = (
            sys.executable,
            "-m",
            "robocorba.servers.smartpal",
            "--state",
            str(folder / "robot"),
            "--naming",
            str(naming),
        )
        with (
            Process(own_naming, folder / "robot-names.log"),
            Process((*within, *robot, "--endpoint", f"{host}:{port + 1}"), folder / "robot.log"),
        ):
            eventually(lambda: _answers(orb, naming), START_LIMIT_S, "the stand-in")
            yield naming


def _answers(orb: Orb, naming: Address) -> bool:
    try:
        faults(orb, naming).none()
    except NotReachable:
        return False
    return True


def faults(orb: Orb, naming: Address) -> Any:
    """The reference that switches the stand-in's faults."""
    return orb.resolve_in_other_naming_service(naming, "Faults", RoboCorba.SmartPalFaults, 2.0)


class RecordedRobot:
    """A recorded robot process; `agent` is the client of its agent."""

    def __init__(self, folder: Path, orb: Orb, at: str, adaptor: Sequence[str] = ()) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)
        where = ("--floor", FLOOR, "--at", at, "--channel", "main", "--naming", str(orb.naming))
        command = (sys.executable, "-m", "bench.robots.recorded_robot", str(folder), NAME, *where)
        self.process = Process((*command, "--state", str(folder), *adaptor), folder / "robot.log")
        try:
            self.agent = eventually(lambda: self._find(orb), START_LIMIT_S, "the robot")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RecordedRobot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process, which writes its ticks."""
        self.process.__exit__(None, None, None)

    def stops(self, since: float) -> list[dict[str, Any]]:
        """Stops and hangs of its adaptor since a time."""
        lines = (self._folder / "stops.jsonl").read_text().splitlines()
        return [one for one in map(json.loads, lines) if one["at"] >= since]

    def ticks(self) -> Floats:
        """Ticks (n, 45), after `close`: start and end of the read and of the write; time and heading of the state;
        velocity, joints and joint velocities of the command."""
        found: Floats = np.load(self._folder / "ticks.npy")
        return found

    @staticmethod
    def _find(orb: Orb) -> RemoteAgent | None:
        try:
            agent = RemoteAgent(orb, NAME, 0.2)
            agent.state()
        except NotReachable:
            time.sleep(0.05)
            return None
        return agent
