"""The processes of a system, as its supervisor shows them, and orders to start robots."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

import msgspec

from robocorba.system.decoding import decode_json

#: What the name of a robot's process begins with; the robot's name follows.
_ROBOT = "robot_"
#: What a line about a robot's progress begins with.
_PROGRESS = "progress "


class ProcessPhase(Enum):
    """ENDED: a robot; servers are restarted."""

    STARTING = "starting"
    READY = "ready"
    STOPPING = "stopping"
    ENDED = "ended"


@dataclass(frozen=True)
class ProcessState:
    """A process of a system.

    pid: 0 while there is none. since: POSIX time of its present start [s], 0 before the first one. bound_names: in the
    naming service. problem: why it ended or is not ready; empty if all is well."""

    name: str
    phase: ProcessPhase
    pid: int
    restarts: int
    since: float
    bound_names: tuple[str, ...] = ()
    problem: str = ""

    @property
    def robot(self) -> str:
        """The robot's name; empty for any other process."""
        return self.name.removeprefix(_ROBOT) if self.name.startswith(_ROBOT) else ""


@dataclass(frozen=True)
class RobotOrder:
    """A robot to start, as by the options of `robocorba robot`.

    floor: empty for the lowest one. at: x, y [m] and heading [rad] on the floor, None for the first free path node.
    channel: of its sub-network, empty for that of its area. program: a file to run immediately; None for none.
    perceive: what it avoids, empty for the default."""

    name: str
    adaptor: str = "simulated"
    adaptor_arguments: tuple[str, ...] = ()
    floor: str = ""
    at: tuple[float, float, float] | None = None
    channel: str = ""
    program: Path | None = None
    perceive: str = ""

    @property
    def process(self) -> str:
        """The name of its process, and of its log file."""
        return _ROBOT + self.name


class RobotProgress(msgspec.Struct, frozen=True):
    """What a robot does, as its process prints it on a line of its own whenever it changes.

    kind, text: what its touch panel shows; kind: working, waiting or exceptional. task: its present or last program or
    mission, empty for none. result: of the last task once it has ended."""

    kind: str = "waiting"
    text: str = ""
    task: str = ""
    result: str = ""

    def line(self) -> str:
        """The line that `read` reads, without a line break."""
        short = RobotProgress(*(text[:1000] for text in msgspec.structs.astuple(self)))
        return _PROGRESS + msgspec.json.encode(short).decode()

    @staticmethod
    def read(line: str) -> RobotProgress | None:
        """None for a line that is about something else."""
        if not line.startswith(_PROGRESS):
            return None
        try:
            return decode_json(line.removeprefix(_PROGRESS), RobotProgress)
        except msgspec.MsgspecError:
            return None


class Processes(Protocol):
    """The supervisor of a system."""

    def processes(self) -> list[ProcessState]: ...

    def start_robot(self, order: RobotOrder) -> None:
        """Start a robot as a process of this system. Returns at once. Raises InvalidChoice, ProcessExists."""

    def end_robot(self, name: str) -> None:
        """End a robot that was started here, by its name or that of its process. Raises UnknownProcess."""

    def log_lines(self, name: str, lines: int) -> list[str]:
        """The last lines of a process's log, at most MAX_LOG_LINES. Raises UnknownProcess."""


#: Maximum number of lines of `log_lines`.
MAX_LOG_LINES = 500
