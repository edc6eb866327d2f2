"""Errors of robots: programs, motions, adaptors, plans and missions."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.paths import Blocker


class RobotError(RoboCorbaError):
    """A robot client refuses or fails."""


class InvalidProgram(RobotError):
    """`icon` is a path into the program, such as icons[2].icons[0], empty for the program as a whole; `parameter` names
    what is wrong in it."""

    def __init__(self, icon: str, parameter: str, reason: str) -> None:
        self.icon, self.parameter, self.reason = icon, parameter, reason
        where = ".".join(filter(None, (icon, parameter)))
        super().__init__(f"{where}: {reason}" if where else reason)


class Unreachable(RobotError):
    """`hand` (left or right) can't get where it shall."""

    def __init__(self, hand: str, reason: str) -> None:
        self.hand, self.reason = hand, reason
        super().__init__(f"the {hand} hand: {reason}")


class IllegalOrder(RobotError):
    """The robot can't do what was asked for in the `condition` that it is in."""

    def __init__(self, order: str, condition: str) -> None:
        self.order, self.condition = order, condition
        super().__init__(f"can't {order}: the robot {condition}")


class UnknownAdaptor(RobotError):
    """No adaptor is called `name`; `known` lists those that are installed."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name, self.known = name, tuple(known)
        super().__init__(f"there is no adaptor {name[:80]!r}; known are {', '.join(self.known)}")


class UnknownPlan(RobotError):
    """The data pool holds no plan of this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no plan {name[:80]!r}")


class InvalidPlan(FieldError, RobotError):
    """`field` of a cooperative plan can't be kept."""


class StalePlan(RobotError):
    """The plan is at version `current`: somebody else changed it."""

    def __init__(self, name: str, expected: int, current: int) -> None:
        self.name, self.expected, self.current = name, expected, current
        super().__init__(f"plan {name[:80]!r} is at version {current}, not {expected}")


class InvalidCarry(FieldError, RobotError):
    """`field` of a carry can't be: `reason` says why."""


class ImpossibleCarry(RobotError):
    """An object can't be carried there by so many robots; `blockers` names what stands in the way."""

    def __init__(self, reason: str, blockers: Sequence[Blocker] = ()) -> None:
        self.reason, self.blockers = reason, tuple(blockers)
        super().__init__("; ".join([reason, *map(str, self.blockers)]))


class MotionFailed(RobotError):
    """The robot did not get where it should."""


class MissionFailed(RobotError):
    """A mission came to nothing; nothing was left in the hands of its robots."""


class AdaptorFailed(RobotError):
    """The robot behind an adaptor does not do what it is told; `cause` says why."""

    def __init__(self, cause: str) -> None:
        self.cause = cause
        super().__init__(cause)


class UnitFailed(AdaptorFailed):
    """`unit` of the actual robot refused: its return or state code, and why."""

    def __init__(self, unit: str, code: int, reason: str) -> None:
        self.unit, self.code = unit, code
        super().__init__(f"{unit}: {reason} ({code})")


class RobotLost(AdaptorFailed):
    """Nobody answers for the robot any more; once somebody does again, it can be started again."""
