"""Checks of the mobile base in a program: it can drive from each place to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from robocorba.errors.paths import InvalidPoint, NotFree, PathError, UnknownFloor
from robocorba.planning.request import Path, PathRequest, Place, RouteMode
from robocorba.programs.icons import HandOver, Icon, MbaseBy, MbasePath, MbaseTo, MbaseVelocity, MoveTable
from robocorba.programs.report import CheckReport

#: A path this much longer than the straight line goes around an obstacle [m].
_DETOUR_M = 0.01


class Planner(Protocol):
    """The path planning agent: a `robocorba.planning.planner.PathPlanner`, or a remote one over CORBA."""

    def paths(self, request: PathRequest) -> Sequence[Path]:
        """The best path first. Raises PathError."""


@dataclass(frozen=True)
class BaseAt:
    """Where the base is. If not `is_known`, `place` is the last known place, None if there was none."""

    place: Place | None = None
    heading: float | None = None
    is_known: bool = False

    def lost(self) -> BaseAt:
        """The base after a motion of unknown length."""
        return BaseAt(self.place)

    def or_at(self, other: BaseAt) -> BaseAt:
        """What is equal in both stays known."""
        if self == other:
            return self
        is_same_place = self.is_known and other.is_known and self.place == other.place
        return BaseAt(self.place or other.place, is_known=is_same_place)


class BaseChecks:
    """Follows the base through a program and reports what is impossible. Without a planner it only follows."""

    def __init__(self, report: CheckReport, planner: Planner | None) -> None:
        self._report, self._planner = report, planner

    def after(self, path: str, icon: Icon, at: BaseAt) -> BaseAt:
        """Where the base is after an icon that contains no others."""
        if isinstance(icon, MbasePath):
            return self._along_path(path, icon, at)
        if isinstance(icon, MbaseTo):
            return self._straight_to(path, icon, at)
        if isinstance(icon, MbaseBy):
            return self._by(path, icon, at)
        if isinstance(icon, MbaseVelocity):
            return at.lost() if icon.ahead or icon.left or icon.turn else at
        if isinstance(icon, MoveTable | HandOver):
            self._report.note(path, "the mission layer expands it: not proved here")
            return at.lost()
        return at

    def _along_path(self, path: str, icon: MbasePath, at: BaseAt) -> BaseAt:
        goal = Place(icon.floor, icon.x, icon.y)
        if self._planner:
            if not at.place:
                self._report.note(path, "the start of the drive is unknown: proved only that its end is free")
            elif not at.is_known:
                self._report.note(path, "the start of the drive is unknown: proved from the last known place")
            if self._path_m(path, at.place or goal, goal, RouteMode.SMOOTHED, "x, y") is None:
                return at.lost()
        return BaseAt(goal, icon.heading, is_known=True)

    def _straight_to(self, path: str, icon: MbaseTo, at: BaseAt) -> BaseAt:
        if not at.place or not at.is_known:
            self._note_unknown(path)
            return at.lost()
        goal = Place(at.place.floor, icon.x, icon.y)
        if not self._is_straight(path, at.place, goal, "x, y"):
            return at.lost()
        return BaseAt(goal, at.heading if icon.heading is None else icon.heading, is_known=True)

    def _by(self, path: str, icon: MbaseBy, at: BaseAt) -> BaseAt:
        heading = None if at.heading is None else at.heading + icon.turn
        if not (icon.ahead or icon.left):
            return replace(at, heading=heading)
        if not at.place or at.heading is None or not at.is_known:
            self._note_unknown(path)
            return at.lost()
        c, s = math.cos(at.heading), math.sin(at.heading)
        floor, x, y = at.place
        goal = Place(floor, x + c * icon.ahead - s * icon.left, y + s * icon.ahead + c * icon.left)
        if not self._is_straight(path, at.place, goal, "ahead, left"):
            return at.lost()
        return BaseAt(goal, heading, is_known=True)

    def _note_unknown(self, path: str) -> None:
        if self._planner:
            self._report.note(path, "the start of the drive is unknown: not proved that it is free")

    def _is_straight(self, path: str, start: Place, goal: Place, parameter: str) -> bool:
        """Whether the straight line is free, as far as its start is known; reports an obstacle."""
        if not self._planner:
            return True
        length_m = self._path_m(path, start, goal, RouteMode.GEOMETRIC, parameter)
        if length_m is None:
            return False
        if length_m > math.dist(start[1:], goal[1:]) + _DETOUR_M:
            line = f"from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f}) on {goal.floor}"
            self._report.find(path, parameter, f"an obstacle blocks the straight line {line}")
            return False
        return True

    def _path_m(self, path: str, start: Place, goal: Place, mode: RouteMode, parameter: str) -> float | None:
        """Length of the path [m]; None if there is none, which is reported."""
        assert self._planner
        try:
            return self._planner.paths(PathRequest(start, goal, mode=mode))[0].distance
        except PathError as error:
            if isinstance(error, UnknownFloor | InvalidPoint | NotFree) and error.which == "start" and start != goal:
                parameter = ""
            elif isinstance(error, UnknownFloor):
                parameter = "floor"
            self._report.find(path, parameter, str(error))
            return None
