"""Errors of the path planning agent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from robocorba.errors.base import FieldError, RoboCorbaError, StructuredError
from robocorba.errors.maps import describe
from robocorba.errors.places import place


class PathError(RoboCorbaError):
    """Base of all errors of the path planning agent."""


class InvalidPoint(StructuredError, PathError):
    """`which` is start or goal, `field` the wrong member."""

    which: str
    field: str
    reason: str
    message = "{which}.{field}: {reason}"


class InvalidRequest(FieldError, PathError):
    """`field` is the wrong member of the request."""


class UnknownFloor(StructuredError, PathError):
    """`which` is start, goal or an area; `known` lists the existing floors."""

    which: str
    floor: str
    known: Sequence[str]
    message = "{which}: there is no floor {floor!r}; known are {known!l}"


class NotFree(StructuredError, PathError):
    """The robot does not fit at start or goal: it is `clearance_m` from `obstacle` and needs `required_m`."""

    which: str
    floor: str
    x: float
    y: float
    obstacle: str
    clearance_m: float
    required_m: float
    message = "{which} {place} is not free: {clearance_m:.3f} m to {obstacle}, {required_m:.3f} m needed"

    @property
    def place(self) -> str:
        """The place in messages."""
        return place(self.floor, self.x, self.y)


class Blocker(NamedTuple):
    """An element that blocks every path."""

    kind: str
    floor: str
    name: str
    reason: str

    def __str__(self) -> str:
        return f"{describe(self.kind, self.floor, self.name)}: {self.reason}"


class NoPath(StructuredError, PathError):
    """No path leads from start to goal; `blockers` names the elements that block it."""

    reason: str
    blockers: Sequence[Blocker] = ()

    def __str__(self) -> str:
        return "; ".join([self.reason, *map(str, self.blockers)])


class PlannerBusy(PathError):
    """As many queries wait as may wait; nothing was done. Try again."""


class PlanningTimeout(StructuredError, PathError):
    """A query exceeded its time limit; `floor` is the floor that was searched."""

    floor: str
    message = "the search on floor {floor} exceeded its time limit; ask for a shorter path, or raise the limit"
