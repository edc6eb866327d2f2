"""A robot process with a recorder between its control agent and its adaptor, which can also make the adaptor hang.

    python -m bench.robots.recorded_robot FOLDER NAME [options of clients/robot]

Otherwise it is clients/robot. It appends each stop of the adaptor to FOLDER/stops.jsonl, and writes all ticks to
FOLDER/ticks.npy at the end. After SIGUSR1 the next write takes HANG_S. Times are those of time.monotonic, which all
processes of a machine share."""

from __future__ import annotations

import atexit
import contextlib
import json
import signal
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robocorba.clients import robot
from robocorba.errors.services import NotReachable
from robocorba.map_editor import native
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.orb.orb import Orb
from robocorba.robot import model_switcher
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from testkit.buildings import two_floors
from testkit.json_process import Process, checkout_command
from testkit.processes import Running, eventually, running_system

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
        command = checkout_command("bench.robots.recorded_robot", str(folder), NAME, *where, *more)
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


# ---- the process ----


#: Maximum number of recorded ticks: one hour.
MAX_TICKS = 180_000
#: Duration of a hang [s].
HANG_S = 2.5


class Recorder:
    """Records one process; its adaptors can be made again and in any thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stops = (folder / "stops.jsonl").open("w", buffering=1)
        self.ticks: deque[tuple[float, ...]] = deque(maxlen=MAX_TICKS)
        self._hangs = False
        signal.signal(signal.SIGUSR1, self._let_hang)
        atexit.register(self._save)

    def note(self, event: str, began: float) -> None:
        self._stops.write(json.dumps({"event": event, "at": began, "done": time.monotonic()}) + "\n")

    def may_hang(self) -> None:
        """Called before each write."""
        if self._hangs:
            self._hangs = False
            self.note("hang", time.monotonic())
            time.sleep(HANG_S)

    def _let_hang(self, *_: object) -> None:
        self._hangs = True

    def _save(self) -> None:
        ticks = list(self.ticks)
        np.save(self._folder / "ticks.npy", np.array([tick for tick in ticks if len(tick) == len(ticks[-1])]))


class RecordedAdaptor(RobotAdaptor):
    """Records the calls of another adaptor."""

    def __init__(self, adaptor: RobotAdaptor, recorder: Recorder) -> None:
        self._adaptor, self._recorder = adaptor, recorder
        self.is_in_building = adaptor.is_in_building
        self._read = (0.0, 0.0)
        self._state = RobotState()

    def start(self, argv: Sequence[str]) -> bool:
        return self._adaptor.start(argv)

    def stop(self) -> bool:
        began = time.monotonic()
        try:
            return self._adaptor.stop()
        finally:
            self._recorder.note("stop", began)

    def read(self, state: RobotState) -> bool:
        began = time.monotonic()
        answer = self._adaptor.read(state)
        self._read, self._state = (began, time.monotonic()), state
        return answer

    def write(self, command: ActorCommand) -> bool:
        self._recorder.may_hang()
        began = time.monotonic()
        answer = self._adaptor.write(command)
        times = (*self._read, began, time.monotonic(), self._state.time, self._state.heading)
        joints = (*command.joints.tolist(), *command.joint_velocities.tolist())
        self._recorder.ticks.append((*times, *command.velocity, *joints))
        return answer


def main(folder: str, *arguments: str) -> None:
    make, recorder = model_switcher.make, Recorder(Path(folder))

    def recorded(name: str, surroundings: AdaptorContext) -> RobotAdaptor:
        return RecordedAdaptor(make(name, surroundings), recorder)

    model_switcher.make = recorded
    robot.main(arguments)


if __name__ == "__main__":
    main(*sys.argv[1:])
