"""Every tick of the programs that a robot runs, in a CSV file: how the robot was, and what it was told.

For whoever wants to know why a robot moved as it did, or how a virtual robot and an actual one differ."""

from __future__ import annotations

import contextlib
import csv
import logging
import queue
import threading
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from robocorba.errors.base import RoboCorbaError
from robocorba.kinematics.smartpal import JOINTS
from robocorba.motion.robot_state import ActorCommand, RobotState

#: In this order: which robot does what, where it was, and what it was told then, in m, rad, m/s, rad/s, s.
COLUMNS = (
    *("adaptor", "program", "icon", "icons_done", "floor", "time", "x", "y", "heading", "ahead", "left", "turn"),
    *("told_ahead", "told_left", "told_turn", *JOINTS, *(f"told_{joint}" for joint in JOINTS)),
)
#: A file holds no more ticks, one hour of programs and 100 MB; so many may wait for a slow disk.
MAX_TICKS, MAX_QUEUED = 180_000, 500
END_LIMIT_S = 5.0

_log = logging.getLogger(__name__)


class Tick(NamedTuple):
    """icon: a path such as icons[2].then[0]. icons_done: before it. command: what `state` was answered with."""

    adaptor: str
    program: str
    icon: str
    icons_done: int
    floor: str
    state: RobotState
    command: ActorCommand


class TickFile:
    """A new file. `add` never waits, so that no disk delays a robot: a thread of its own writes. Ticks that a slow disk
    can't take are left out, and the log tells how many. Raises RoboCorbaError where the file can't be made."""

    def __init__(self, file: Path, max_ticks: int = MAX_TICKS) -> None:
        try:
            self._file = file.open("w", newline="")
        except OSError as wrong:
            raise RoboCorbaError(f"can't write {file}: {wrong.strerror or wrong}") from None
        self._waiting: queue.Queue[Tick | None] = queue.Queue(MAX_QUEUED)
        self._left, self.left_out = max_ticks, 0
        self._thread = threading.Thread(target=self._write, name="tick file", daemon=True)
        self._thread.start()

    def __enter__(self) -> TickFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def add(self, tick: Tick) -> None:
        """By one thread; what `tick` holds is not changed any more."""
        try:
            if self._left:
                self._waiting.put_nowait(tick)
                self._left -= 1
                return
        except queue.Full:
            pass
        self.left_out += 1

    def close(self) -> None:
        """Write what waits."""
        with contextlib.suppress(queue.Full):
            if self._thread.is_alive():
                self._waiting.put(None, timeout=END_LIMIT_S)
        self._thread.join(END_LIMIT_S)
        if self.left_out:
            _log.warning("%d ticks were left out of %s", self.left_out, self._file.name)

    def _write(self) -> None:
        try:
            with self._file:
                rows = csv.writer(self._file)
                rows.writerow(COLUMNS)
                while tick := self._waiting.get():
                    rows.writerow(_row(tick))
                    if self._waiting.empty():
                        self._file.flush()  # whoever reads along sees it now
        except OSError as wrong:
            _log.warning("can't write %s any more: %s", self._file.name, wrong)


def _row(tick: Tick) -> list[str]:
    state, command = tick.state, tick.command
    numbers = [state.time, state.x, state.y, state.heading, *state.velocity, *command.velocity]
    joints = [*_cells(state.joints), *_cells(command.joints)]
    return [*map(str, tick[:5]), *(f"{number:.6f}" for number in numbers), *joints]


def _cells(joints: Iterable[float]) -> list[str]:
    """Empty for a robot that has other joints than SmartPal, or none."""
    cells = [f"{joint:.6f}" for joint in joints]
    return cells if len(cells) == len(JOINTS) else [""] * len(JOINTS)
