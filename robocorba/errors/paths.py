"""Errors of the path planning agent."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.maps import describe


class PathError(RoboCorbaError):
    """The path planning agent refuses or fails."""


class InvalidPoint(PathError):
    """`which` is start or goal, `field` the member that is wrong."""

    def __init__(self, which: str, field: str, reason: str) -> None:
        self.which, self.field, self.reason = which, field, reason
        super().__init__(f"{which}.{field}: {reason}")


class InvalidRequest(FieldError, PathError):
    """`field` is the member of the request that is wrong."""


class UnknownFloor(PathError):
    """`which` is start, goal or an area; `known` lists the floors there are."""

    def __init__(self, which: str, floor: str, known: Sequence[str]) -> None:
        self.which, self.floor, self.known = which, floor, tuple(known)
        super().__init__(f"{which}: there is no floor {floor!r}; known are {', '.join(self.known)}")


class NotFree(PathError):
    """The robot does not fit at start or goal: `clearance_m` to `obstacle`, `required_m` needed."""

    def __init__(
        self, which: str, floor: str, x: float, y: float, obstacle: str, clearance_m: float, required_m: float
    ) -> None:
        self.which, self.floor, self.x, self.y = which, floor, x, y
        self.obstacle, self.clearance_m, self.required_m = obstacle, clearance_m, required_m
        super().__init__(
            f"{which} {floor}:{x:g},{y:g} is not free: {clearance_m:.3f} m to {obstacle}, {required_m:.3f} m needed"
        )


class Blocker:
    """One thing that stands in the way of every path."""

    def __init__(self, kind: str, floor: str, name: str, reason: str) -> None:
        self.kind, self.floor, self.name, self.reason = kind, floor, name, reason

    def __str__(self) -> str:
        return f"{describe(self.kind, self.floor, self.name)}: {self.reason}"


class NoPath(PathError):
    """Nothing leads from start to goal; `blockers` names what stands in the way."""

    def __init__(self, reason: str, blockers: Sequence[Blocker] = ()) -> None:
        self.reason, self.blockers = reason, tuple(blockers)
        super().__init__("; ".join([reason, *map(str, self.blockers)]))


class PlanningTimeout(PathError):
    """A query was given up when its time was over; `floor` is the floor that was searched."""

    def __init__(self, floor: str) -> None:
        self.floor = floor
        super().__init__(f"the search on floor {floor} ran out of time; ask for a shorter way, or raise the deadline")
