"""A robot process with a recorder between its control agent and its adaptor, which can also make the adaptor hang.

    python -m bench.robots.recorded_robot FOLDER NAME [options of clients/robot]

Otherwise it is clients/robot. It appends each stop of the adaptor to FOLDER/stops.jsonl, and writes all ticks to
FOLDER/ticks.npy at the end. After SIGUSR1 the next write takes HANG_S. Times are those of time.monotonic, which all
processes of a machine share."""

from __future__ import annotations

import atexit
import json
import signal
import sys
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robocorba.clients import robot
from robocorba.control import model_switcher
from robocorba.control.adaptor import RobotAdaptor
from robocorba.control.model_switcher import Surroundings
from robocorba.motion.robot_state import ActorCommand, RobotState

#: Most ticks that are recorded: one hour.
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

    def recorded(name: str, surroundings: Surroundings) -> RobotAdaptor:
        return RecordedAdaptor(make(name, surroundings), recorder)

    model_switcher.make = recorded
    robot.main(arguments)


if __name__ == "__main__":
    main(*sys.argv[1:])
