"""Errors of the path planning agent."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.maps import describe
from robocorba.errors.places import place


class PathError(RoboCorbaError):
    """Base of all errors of the path planning agent."""


class InvalidPoint(PathError):
    """`which` is start or goal, `field` the wrong member."""

    def __init__(self, which: str, field: str, reason: str) -> None:
        self.which, self.field, self.reason = which, field, reason
        super().__init__(f"{which}.{field}: {reason}")


class InvalidRequest(FieldError, PathError):
    """`field` is the wrong member of the request."""


class UnknownFloor(PathError):
    """`which` is start, goal or an area; `known` lists the existing floors."""

    def __init__(self, which: str, floor: str, known: Sequence[str]) -> None:
        self.which, self.floor, self.known = which, floor, tuple(known)
        super().__init__(f"{which}: there is no floor {floor!r}; known are {', '.join(self.known)}")


class NotFree(PathError):
    """The robot does not fit at start or goal: it is `clearance_m` from `obstacle` and needs `required_m`."""

    def __init__(
        self, which: str, floor: str, x: float, y: float, obstacle: str, clearance_m: float, required_m: float
    ) -> None:
        self.which, self.floor, self.x, self.y = which, floor, x, y
        self.obstacle, self.clearance_m, self.required_m = obstacle, clearance_m, required_m
        super().__init__(
            f"{which} {place(floor, x, y)} is not free: {clearance_m:.3f} m to {obstacle}, {required_m:.3f} m needed"
        )


class Blocker:
    """An element that blocks every path."""

    def __init__(self, kind: str, floor: str, name: str, reason: str) -> None:
        self.kind, self.floor, self.name, self.reason = kind, floor, name, reason

    def __str__(self) -> str:
        return f"{describe(self.kind, self.floor, self.name)}: {self.reason}"


class NoPath(PathError):
    """No path leads from start to goal; `blockers` names the elements that block it."""

    def __init__(self, reason: str, blockers: Sequence[Blocker] = ()) -> None:
        self.reason, self.blockers = reason, tuple(blockers)
        super().__init__("; ".join([reason, *map(str, self.blockers)]))


class PlannerBusy(PathError):
    """As many queries wait as may wait; nothing was done. Try again."""


class PlanningTimeout(PathError):
    """A query exceeded its time limit; `floor` is the floor that was searched."""

    def __init__(self, floor: str) -> None:
        self.floor = floor
        super().__init__(
            f"the search on floor {floor} exceeded its time limit; ask for a shorter path, or raise the limit"
        )
