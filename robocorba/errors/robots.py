"""Errors of robots: programs, motions, adaptors, plans and missions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.paths import Blocker


class RobotError(RoboCorbaError):
    """A robot refuses a request or fails."""


class InvalidProgram(RobotError):
    """A program is invalid.

    icon: a path in the program, such as icons[2].icons[0], empty for the whole program. parameter: the invalid
    parameter of that icon."""

    def __init__(self, icon: str, parameter: str, reason: str) -> None:
        self.icon, self.parameter, self.reason = icon, parameter, reason
        where = ".".join(filter(None, (icon, parameter)))
        super().__init__(f"{where}: {reason}" if where else reason)


class Unreachable(RobotError):
    """`hand` (left or right) can't reach its target."""

    def __init__(self, hand: str, reason: str) -> None:
        self.hand, self.reason = hand, reason
        super().__init__(f"the {hand} hand: {reason}")


class IllegalOrder(RobotError):
    """The robot can't execute `order` in its present `condition`."""

    def __init__(self, order: str, condition: str) -> None:
        self.order, self.condition = order, condition
        super().__init__(f"can't {order}: the robot {condition}")


class UnknownAdaptor(RobotError):
    """No adaptor is called `name`; `known` lists the installed ones."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name, self.known = name, tuple(known)
        super().__init__(f"there is no adaptor {name[:80]!r}; known are {', '.join(self.known)}")


class UnknownPlan(RobotError):
    """The data pool holds no plan of this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no plan {name[:80]!r}")


class InvalidPlan(FieldError, RobotError):
    """`field` of a cooperative plan is invalid."""


class StalePlan(RobotError):
    """The plan is at version `current`, not `expected`, because another writer has changed it."""

    def __init__(self, name: str, expected: int, current: int) -> None:
        self.name, self.expected, self.current = name, expected, current
        super().__init__(f"plan {name[:80]!r} is at version {current}, not {expected}")


class InvalidCarry(FieldError, RobotError):
    """`field` of a carry is invalid; `reason` is the cause."""


class ImpossibleCarry(RobotError):
    """An object can't be carried to its goal by this number of robots; `blockers` are the obstacles."""

    def __init__(self, reason: str, blockers: Sequence[Blocker] = ()) -> None:
        self.reason, self.blockers = reason, tuple(blockers)
        super().__init__("; ".join([reason, *map(str, self.blockers)]))


class MotionFailed(RobotError):
    """The robot did not reach its target."""


class RideLost(MotionFailed):
    """The robot's elevator ride has ended before it was at its destination: its session ended, or the doors closed."""

    def __init__(self, ride: str, when: str = "") -> None:
        super().__init__(f"{ride}: the ride was lost{f' {when}' if when else ''}")


class MissionFailed(RobotError):
    """A mission failed; its robots no longer hold the object."""


class InTheWay(MissionFailed):
    """Robots stand where a mission needs room. aside: where each of them would step aside, as its floor, x and y [m];
    None where there is no room for it."""

    def __init__(self, aside: Mapping[str, tuple[str, float, float] | None]) -> None:
        self.aside = dict(aside)
        super().__init__(f"in the way: {', '.join(sorted(self.aside))}")


class GoalReached(MissionFailed):
    """There is nothing to do: what a mission is about is where it should be."""


class MissionTakenOver(MissionFailed):
    """Another robot leads the mission now, since term `term`."""

    def __init__(self, leader: str, term: int) -> None:
        self.leader, self.term = leader, term
        super().__init__(f"{leader} has taken the mission over, in term {term}")


class AdaptorFailed(RobotError):
    """The robot behind an adaptor has failed because of `cause`."""

    def __init__(self, cause: str) -> None:
        self.cause = cause
        super().__init__(cause)


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
