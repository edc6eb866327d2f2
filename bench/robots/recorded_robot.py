"""A robot process with a recorder between its control agent and its adaptor.

    python -m bench.robots.recorded_robot FOLDER NAME [options of clients/robot]

Otherwise it is clients/robot. It appends the time of each stop of the adaptor to FOLDER/stops, and writes all ticks to
FOLDER/ticks.npy at the end. Times are those of time.monotonic, which all processes of a machine share."""

from __future__ import annotations

import atexit
import contextlib
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.common.harness import System, system
from robocorba.clients import robot
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.orb.orb import Orb
from robocorba.robot import model_switcher
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from testkit.buildings import two_floors
from testkit.json_process import Process, checkout_command
from testkit.processes import eventually

START_LIMIT_S = 300.0
NAME, FLOOR = "A", "L1"
#: Maximum number of recorded ticks: one hour.
MAX_TICKS = 180_000


@contextlib.contextmanager
def system_on_two_floors() -> Iterator[System]:
    """`robocorba up` on two floors of 20 x 10 m."""
    with system("--subnets", "main", building=two_floors()) as found:
        yield found


class RecordedRobot:
    """A recorded robot process; `agent` is the client of its agent. adaptor: its name and arguments, empty for a
    virtual robot."""

    def __init__(self, folder: Path, orb: Orb, at: str, adaptor: Sequence[str] = ()) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)
        where = ("--floor", FLOOR, "--at", at, "--channel", "main", "--naming", str(orb.naming), "--state", str(folder))
        more = ("--adaptor", adaptor[0], "--", *adaptor[1:]) if adaptor else ()
        command = checkout_command("bench.robots.recorded_robot", str(folder), NAME, *where, *more)
        self.process = Process(command, folder / "robot.log")
        self.agent: RemoteAgent = eventually(lambda: _find(orb), START_LIMIT_S, "the robot")

    def close(self) -> None:
        """End the process, which writes its ticks."""
        with self.process:
            pass

    def stops(self, since: float) -> list[float]:
        """The times of stops of its adaptor since a time."""
        return [at for at in map(float, (self._folder / "stops").read_text().split()) if at >= since]

    def ticks(self) -> Floats:
        """Ticks (n, 45), after `close`: start and end of the read and of the write; time and heading of the state;
        velocity, joints and joint velocities of the command."""
        found: Floats = np.load(self._folder / "ticks.npy")
        return found


def _find(orb: Orb) -> RemoteAgent | None:
    with contextlib.suppress(NotReachable):
        agent = RemoteAgent(orb, NAME, 0.2)
        agent.state()
        return agent
    return None


# ---- the process ----


class Recorder:
    """Records one process; its adaptors can be made again and in any thread."""

    def __init__(self, folder: Path) -> None:
        self._stops = (folder / "stops").open("w", buffering=1)
        self.ticks: deque[tuple[float, ...]] = deque(maxlen=MAX_TICKS)
        atexit.register(lambda: np.save(folder / "ticks.npy", np.array(self.ticks)))

    def note_stop(self) -> None:
        self._stops.write(f"{time.monotonic()}\n")


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
        self._recorder.note_stop()
        return self._adaptor.stop()

    def read(self, state: RobotState) -> bool:
        began = time.monotonic()
        answer = self._adaptor.read(state)
        self._read, self._state = (began, time.monotonic()), state
        return answer

    def write(self, command: ActorCommand) -> bool:
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
