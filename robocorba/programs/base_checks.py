"""What can be proved of the mobile base: that it can get from each place to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from robocorba.errors.paths import InvalidPoint, NotFree, PathError, UnknownFloor
from robocorba.planning.request import Path, PathRequest, Place, RouteMode
from robocorba.programs.icons import HandOver, Icon, MbaseBy, MbasePath, MbaseTo, MbaseVelocity, MoveTable
from robocorba.programs.report import Report

#: A way this much longer than the straight line goes around something, m.
_DETOUR_M = 0.01


class Planner(Protocol):
    """The path planning agent: a `robocorba.planning.planner.PathPlanner`, or one that is reached over CORBA."""

    def paths(self, request: PathRequest) -> Sequence[Path]:
        """The best path first. Raises PathError."""


@dataclass(frozen=True)
class BaseAt:
    """Where the base is. `is_known` False: `place` is the last one that was known; None: none ever was."""

    place: Place | None = None
    heading: float | None = None
    is_known: bool = False

    def lost(self) -> BaseAt:
        """It has moved, nobody knows how far."""
        return BaseAt(self.place)

    def or_at(self, other: BaseAt) -> BaseAt:
        """Either here or there."""
        if self == other:
            return self
        is_same_place = self.is_known and other.is_known and self.place == other.place
        return BaseAt(self.place or other.place, is_known=is_same_place)


class BaseChecks:
    """Follows the base through a program, and tells a report what can't be. Without a planner it only follows."""

    def __init__(self, report: Report, planner: Planner | None) -> None:
        self._report, self._planner = report, planner

    def after(self, path: str, icon: Icon, at: BaseAt) -> BaseAt:
        """Where the base is after an icon that holds no others."""
        if isinstance(icon, MbasePath):
            return self._along_path(path, icon, at)
        if isinstance(icon, MbaseTo):
            return self._straight_to(path, icon, at)
        if isinstance(icon, MbaseBy):
            return self._by(path, icon, at)
        if isinstance(icon, MbaseVelocity):
            return at.lost() if icon.ahead or icon.left or icon.turn else at
        if isinstance(icon, MoveTable | HandOver):
            self._report.note(path, "the mission layer makes icons of it: not proved here")
            return at.lost()
        return at

    def _along_path(self, path: str, icon: MbasePath, at: BaseAt) -> BaseAt:
        goal = Place(icon.floor, icon.x, icon.y)
        if self._planner:
            if not at.place:
                self._report.note(path, "nobody knows where the drive begins: proved only that its end is free")
            elif not at.is_known:
                self._report.note(path, "nobody knows where the drive begins: proved from the last place known")
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
            self._report.note(path, "nobody knows where the drive begins: not proved that it is free")

    def _is_straight(self, path: str, start: Place, goal: Place, parameter: str) -> bool:
        """Whether the straight line is free, as far as anybody knows; tells where it is not."""
        if not self._planner:
            return True
        way_m = self._path_m(path, start, goal, RouteMode.GEOMETRIC, parameter)
        if way_m is None:
            return False
        if way_m > math.dist(start[1:], goal[1:]) + _DETOUR_M:
            line = f"from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f}) on {goal.floor}"
            self._report.find(path, parameter, f"something stands on the straight line {line}")
            return False
        return True

    def _path_m(self, path: str, start: Place, goal: Place, mode: RouteMode, parameter: str) -> float | None:
        """How far it is; None where nothing leads there, which is told."""
        assert self._planner
        try:
            return self._planner.paths(PathRequest(start, goal, mode=mode))[0].distance
        except PathError as wrong:
            if isinstance(wrong, UnknownFloor | InvalidPoint | NotFree) and wrong.which == "start" and start != goal:
                parameter = ""
            elif isinstance(wrong, UnknownFloor):
                parameter = "floor"
            self._report.find(path, parameter, str(wrong))
            return None
