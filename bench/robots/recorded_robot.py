"""A robot process with a recorder between its control agent and its adaptor, which can also make the adaptor hang.

    python -m bench.robots.recorded_robot FOLDER NAME [options of clients/robot]

Otherwise it is clients/robot. It appends each stop of the adaptor to FOLDER/stops.jsonl, and writes all ticks to
FOLDER/ticks.npy at the end. After SIGUSR1 the next write takes HANG_S. Times are those of time.monotonic, which all
processes of a machine share."""

from __future__ import annotations

import atexit
import itertools
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
from robocorba.control.model_switcher import AdaptorContext
from robocorba.motion.robot_state import ActorCommand, RobotState

#: Most ticks that are recorded: one hour.
MAX_TICKS = 180_000
#: Duration of a hang [s].
HANG_S = 2.5


class Recorder:
    """Records one process."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stops = (folder / "stops.jsonl").open("w", buffering=1)
        self._ticks: deque[tuple[float, ...]] = deque(maxlen=MAX_TICKS)
        self._hangs = 0
        signal.signal(signal.SIGUSR1, lambda *_: self._let_hang())

    def tick(
        self, read: tuple[float, float], state: RobotState, write: tuple[float, float], command: ActorCommand
    ) -> None:
        """Record a read and the write after it, with their start and end times."""
        joints = itertools.chain(command.joints.tolist(), command.joint_velocities.tolist())
        self._ticks.append((*read, *write, state.time, state.heading, *command.velocity, *joints))

    def stopped(self, began: float, event: str = "stop") -> None:
        line = {"event": event, "at": began, "done": time.monotonic()}
        self._stops.write(json.dumps(line) + "\n")

    def may_hang(self) -> None:
        """Called before each write."""
        if self._hangs:
            self._hangs = 0
            self.stopped(time.monotonic(), "hang")
            time.sleep(HANG_S)

    def close(self) -> None:
        ticks = list(self._ticks)
        np.save(self._folder / "ticks.npy", np.array([tick for tick in ticks if len(tick) == len(ticks[-1])]))

    def _let_hang(self) -> None:
        self._hangs = 1


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
            self._recorder.stopped(began)

    def read(self, state: RobotState) -> bool:
        began = time.monotonic()
        answer = self._adaptor.read(state)
        self._read, self._state = (began, time.monotonic()), state
        return answer

    def write(self, command: ActorCommand) -> bool:
        self._recorder.may_hang()
        began = time.monotonic()
        answer = self._adaptor.write(command)
        self._recorder.tick(self._read, self._state, (began, time.monotonic()), command)
        return answer


def main(folder: str, arguments: Sequence[str]) -> None:
    recorder = Recorder(Path(folder))
    atexit.register(recorder.close)
    make = model_switcher.make

    def recorded(name: str, context: AdaptorContext) -> RobotAdaptor:
        return RecordedAdaptor(make(name, context), recorder)

    model_switcher.make = recorded
    robot.main(arguments)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
