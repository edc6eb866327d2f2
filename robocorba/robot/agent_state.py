"""The state of a control agent, and of the program or mission that it executes."""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.motion.robot_state import RobotState

#: Name of teleoperation in reports.
TELEOPERATION = "teleoperation"


class ProgramResult(Enum):
    """Result of a program."""

    NO_RESULT = 0
    DONE = 1
    ABORTED = 2
    FAILED = 3


class ProgramReport(NamedTuple):
    """Progress and result of a program. icon: the present icon, a path such as icons[2].then[0]; kind: its type.
    reason: why the program failed or was aborted. seconds: since its start."""

    name: str = ""
    result: ProgramResult = ProgramResult.NO_RESULT
    icon: str = ""
    kind: str = ""
    reason: str = ""
    icons_done: int = 0
    seconds: float = 0.0

    def plain(self) -> dict[str, Any]:
        """Its members, with the result as a word."""
        return {**self._asdict(), "result": self.result.name.lower()}


#: Number of the latest reports of runs that are kept, and of those in an answer.
MAX_REPORTS, MAX_PAGE = 1000, 100


class RunReport(NamedTuple):
    """A run. number: counts the runs of all processes of the agent. upload: number of the program's upload, 0 if it was
    loaded otherwise. ended: POSIX time [s], 0 while it runs."""

    number: int
    upload: int
    ended: float
    program: ProgramReport

    def plain(self) -> dict[str, Any]:
        """Its members, as those of ProgramReport.plain."""
        return {**self._asdict(), "program": self.program.plain()}


class IconBegun(NamedTuple):
    """An icon that has begun. number: counts from 0. seconds: since the program's start."""

    number: int
    icon: str
    kind: str
    seconds: float


class Question(NamedTuple):
    """What a program asks a person. number: of each question another one; 0 if there is none."""

    number: int = 0
    text: str = ""


class AgentCondition(Enum):
    """Condition of a control agent. IDLE: no program runs, also after its end. STOPPED: by an emergency stop or a
    fault, until it is reset."""

    IDLE = 0
    RUNNING = 1
    PAUSED = 2
    STOPPED = 3


class AgentState(NamedTuple):
    """adaptor: its name. reason: why the robot is stopped, or empty. at: the robot's pose. actor: what the adaptor read
    last. speed_cap: [m/s]. jitter_s: greatest lateness of a tick in the last ten seconds."""

    name: str
    adaptor: str
    condition: AgentCondition
    reason: str
    at: Pose
    actor: RobotState
    speed_cap: float
    jitter_s: float
    program: ProgramReport
