"""Errors of robots: programs, motions, adaptors, plans and missions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from robocorba.errors.base import FieldError, NamedError, RoboCorbaError, StructuredError
from robocorba.errors.paths import Blocker


class RobotError(RoboCorbaError):
    """A robot refuses a request or fails."""


class InvalidProgram(StructuredError, RobotError):
    """A program is invalid.

    icon: a path in the program, such as icons[2].icons[0], empty for the whole program. parameter: the invalid
    parameter of that icon."""

    icon: str
    parameter: str
    reason: str

    def __str__(self) -> str:
        where = ".".join(filter(None, (self.icon, self.parameter)))
        return f"{where}: {self.reason}" if where else self.reason


class FingerprintMismatch(StructuredError, RobotError):
    """A program was checked against another `part` (program, robot or map) than the robot has."""

    part: str
    checked: str
    present: str
    message = "the program was checked against the {part} {checked}, but the robot has {present}; check it again"


class Unreachable(StructuredError, RobotError):
    """`hand` (left or right) can't reach its target."""

    hand: str
    reason: str
    message = "the {hand} hand: {reason}"


class IllegalOrder(StructuredError, RobotError):
    """The robot can't execute `order` in its present `condition`."""

    order: str
    condition: str
    message = "can't {order}: the robot {condition}"


class UnknownAdaptor(NamedError, RobotError):
    """No adaptor is called `name`; `known` lists the installed ones."""

    known: Sequence[str]
    message = "there is no adaptor {name!q}; known are {known!l}"


class UnknownPlan(NamedError, RobotError):
    """The data pool holds no plan of this name."""

    message = "there is no plan {name!q}"


class InvalidPlan(FieldError, RobotError):
    """`field` of a cooperative plan, or of the carry to be planned, is invalid."""


class StalePlan(NamedError, RobotError):
    """The plan is at version `current`, not `expected`, because another writer has changed it."""

    expected: int
    current: int
    message = "plan {name!q} is at version {current}, not {expected}"


class ImpossibleCarry(StructuredError, RobotError):
    """An object can't be carried to its goal by this number of robots; `blockers` are the obstacles."""

    reason: str
    blockers: Sequence[Blocker] = ()

    def __str__(self) -> str:
        return "; ".join([self.reason, *map(str, self.blockers)])


class MotionFailed(RobotError):
    """The robot did not reach its target."""


class Blind(MotionFailed):
    """The protective field holds the robot, since there is no present scan of `sensor`; `reason` is the cause."""

    def __init__(self, sensor: str, reason: str) -> None:
        self.sensor, self.reason = sensor, reason
        super().__init__(f"the protective field holds the robot: {sensor}: {reason}")


class Bumped(MotionFailed):
    """The robot has touched something: its bumper has counted `contacts` more."""

    def __init__(self, contacts: int) -> None:
        self.contacts = contacts
        super().__init__(f"the robot stops, since its bumper has counted {contacts} contacts: something touches it")


class RideLost(MotionFailed):
    """The robot's elevator ride has ended before it was at its destination: its session ended, or the doors closed."""

    def __init__(self, ride: str, when: str = "") -> None:
        super().__init__(f"{ride}: the ride was lost{f' {when}' if when else ''}")


class MissionFailed(RobotError):
    """A mission failed; its robots no longer hold the object."""


class InTheWay(StructuredError, MissionFailed):
    """Robots stand where a mission needs room. aside: where each of them would step aside, as its floor, x and y [m];
    None where there is no room for it."""

    aside: Mapping[str, tuple[str, float, float] | None]

    def __str__(self) -> str:
        return f"in the way: {', '.join(sorted(self.aside))}"


class GoalReached(MissionFailed):
    """There is nothing to do: what a mission is about is where it should be."""


class MissionTakenOver(StructuredError, MissionFailed):
    """Another robot leads the mission now, since term `term`."""

    leader: str
    term: int
    message = "{leader} has taken the mission over, in term {term}"


class AdaptorFailed(StructuredError, RobotError):
    """The robot behind an adaptor has failed because of `cause`."""

    cause: str
    message = "{cause}"


class UnitFailed(AdaptorFailed):
    """`unit` of the actual robot has refused a call; `code`: its return or state code."""

    def __init__(self, unit: str, code: int, reason: str) -> None:
        self.unit, self.code = unit, code
        super().__init__(f"{unit}: {reason} ({code})")


class RobotHeld(AdaptorFailed):
    """An emergency stop at the simulation server holds the robot."""


class RobotLost(AdaptorFailed):
    """The robot does not answer any more; it can be restarted once it does."""


class ServerAway(RobotLost):
    """The simulation server does not answer: its process has ended, or is held up. The session goes on when it answers
    again."""
