"""A system of two floors, and a recorded robot process in it."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.processes import Process, bench_command
from robocorba.corba.orb import Orb
from robocorba.corba.remote.agents import RemoteAgent
from robocorba.errors.services import NotReachable
from robocorba.maps import native
from robocorba.spatial.grids import Floats
from robocorba.testing.buildings import two_floors
from robocorba.testing.processes import Running, eventually, running_system

START_LIMIT_S = 300.0
NAME, FLOOR = "A", "L1"


@contextlib.contextmanager
def system_on_two_floors(folder: Path) -> Iterator[tuple[Running, Orb]]:
    """`robocorba up` on two floors of 20 x 10 m, and an ORB."""
    native.save(two_floors(), folder / "two-floors.yaml")
    with (
        running_system(folder, "--building", "two-floors.yaml", "--subnets", "main") as (running, _),
        Orb(running.naming) as orb,
    ):
        yield running, orb


class RecordedRobot:
    """A recorded robot process; `agent` is the client of its agent. adaptor: its name and arguments, empty for a
    virtual robot."""

    def __init__(self, folder: Path, orb: Orb, at: str, adaptor: Sequence[str] = ()) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)
        where = ("--floor", FLOOR, "--at", at, "--channel", "main", "--naming", str(orb.naming), "--state", str(folder))
        more = ("--adaptor", adaptor[0], "--", *adaptor[1:]) if adaptor else ()
        command = bench_command("robots.recorded_robot", str(folder), NAME, *where, *more)
        with contextlib.ExitStack() as stack:
            self.process = stack.enter_context(Process(command, folder / "robot.log"))
            self.agent = eventually(lambda: self._find(orb), START_LIMIT_S, "the robot")
            self._stack = stack.pop_all()

    def __enter__(self) -> RecordedRobot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process, which writes its ticks."""
        self._stack.close()

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
