"""Records each control cycle of a robot's programs in a CSV file: its state and its command.

The file shows why a robot moved as it did, and how a virtual and an actual robot differ."""

from __future__ import annotations

import contextlib
import csv
import logging
import queue
from collections.abc import Iterable
from pathlib import Path

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.files import OutputError
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.system.background import Background

#: Columns: adaptor, program and icon, state, and command (told_*) [s, m, rad, m/s, rad/s].
COLUMNS = (
    *("adaptor", "program", "icon", "icons_done", "floor", "time", "x", "y", "heading", "ahead", "left", "turn"),
    *("told_ahead", "told_left", "told_turn", *JOINTS, *(f"told_{joint}" for joint in JOINTS)),
)
#: Maximum number of queued ticks, while the disk is slow.
MAX_QUEUED = 500

#: Adaptor, program, icon (a path such as icons[2].then[0]), number of icons done before it, and floor.
During = tuple[str, str, str, int, str]
_Tick = tuple[During, RobotState, ActorCommand]

_log = logging.getLogger(__name__)


class TickFile:
    """Creates a file, in place of an earlier one of its kind but of no other. A separate thread writes it, so `add`
    never blocks a robot; ticks beyond the queue or `max_ticks`, one hour of programs and 100 MB, are dropped, and
    `close` logs their number. Raises RoboCorbaError if the file can't be created, OutputError for a file of another
    kind."""

    def __init__(self, file: Path, max_ticks: int = 180_000) -> None:
        try:
            if file.is_file() and not _is_replaceable(file):
                raise OutputError(file, "exists already; it is no record of control cycles, choose another name")
            self._file = file.open("w", newline="")
        except OSError as error:
            raise RoboCorbaError(f"can't create {file}: {error.strerror or error}") from None
        self._waiting: queue.Queue[_Tick | None] = queue.Queue(MAX_QUEUED)
        self._remaining, self.dropped = max_ticks, 0
        self._thread = Background("tick file", self._write, self._end)
        self._thread.start()

    def add(self, during: During, state: RobotState, command: ActorCommand) -> None:
        """Queue a tick; command: the one written after `state` was read. One thread at a time; the caller no longer
        changes state and command."""
        try:
            if self._remaining:
                self._waiting.put_nowait((during, state, command))
                self._remaining -= 1
                return
        except queue.Full:
            pass
        self.dropped += 1

    def close(self) -> None:
        """Write the queued ticks, and close the file."""
        with contextlib.suppress(queue.Full):
            if self._thread.is_alive():
                self._waiting.put(None, timeout=5.0)
        self._thread.join(5.0)
        if self.dropped:
            _log.warning("%s lacks %d ticks: the disk was too slow or the file is full", self._file.name, self.dropped)

    def _write(self) -> None:
        try:
            with self._file:
                rows = csv.writer(self._file)
                rows.writerow(COLUMNS)
                while tick := self._waiting.get():
                    rows.writerow(_row(*tick))
                    if self._waiting.empty():
                        self._file.flush()  # for readers of the growing file
        except OSError as error:
            self._end(str(error))

    def _end(self, reason: str) -> None:
        """Record no more."""
        self._remaining = 0
        _log.warning("stopped recording to %s: %s", self._file.name, reason)


def _is_replaceable(file: Path) -> bool:
    """Whether a file is empty or a record of ticks."""
    head = ",".join(COLUMNS[:6]).encode()
    with file.open("rb") as existing:
        return existing.read(len(head)) in (b"", head)


def _row(during: During, state: RobotState, command: ActorCommand) -> list[str]:
    numbers = [state.time, state.x, state.y, state.heading, *state.velocity, *command.velocity]
    joints = [*_cells(state.joints), *_cells(command.joints)]
    return [*map(str, during), *(f"{number:.6f}" for number in numbers), *joints]


def _cells(joints: Iterable[float]) -> list[str]:
    """Empty cells for a robot without SmartPal's joints."""
    cells = [f"{joint:.6f}" for joint in joints]
    return cells if len(cells) == len(JOINTS) else [""] * len(JOINTS)
