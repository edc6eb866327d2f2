"""Checks of the mobile base in a program: it can drive from each point to the next."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from robocorba.errors.paths import InvalidPoint, NotFree, PathError, UnknownFloor
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.planning.request import Path, PathRequest, Place, RouteMode
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.programs.icons import CooperativeIcon, Gripper, Icon, MbaseBy, MbasePath, MbaseTo, MbaseVelocity
from robocorba.robot.programs.report import CheckReport

#: The icons that move the base.
BaseIcon = MbasePath | MbaseTo | MbaseBy | MbaseVelocity
#: A robot that touches an obstacle plans with a radius that is smaller by this [m], so that it can leave.
CONTACT_M = 0.02


class Planner(Protocol):
    """The path planning agent: a `robocorba.planning.planner.PathPlanner`, or a remote one over CORBA."""

    def paths(self, request: PathRequest) -> Sequence[Path]:
        """The best path first. Raises PathError."""


@dataclass(frozen=True)
class KnownBase:
    """What a check knows of the base between two icons. heading: [rad], None if unknown. If not `is_known`, `place` is
    the last known point, None if there was none."""

    place: Place | None = None
    heading: float | None = None
    is_known: bool = False

    def with_unknown_pose(self) -> KnownBase:
        """The base after a motion of unknown length."""
        return KnownBase(self.place)

    def merged_with(self, other: KnownBase) -> KnownBase:
        """What is known if either state is possible."""
        if self == other:
            return self
        is_same_place = self.is_known and other.is_known and self.place == other.place
        return KnownBase(self.place or other.place, is_known=is_same_place)


class BaseChecks:
    """Tracks the base through a program, and reports impossible drives. Without a planner it only tracks.

    obstacles: objects where they stand at the start; those that the program moves are ignored from then on.
    robots: other robots that stand still; they may have left when this robot comes, so a target there is only noted."""

    def __init__(
        self,
        report: CheckReport,
        planner: Planner | None,
        obstacles: TemporaryObstacles = NO_OBSTACLES,
        robots: TemporaryObstacles = NO_OBSTACLES,
    ) -> None:
        self._report, self._planner, self._obstacles, self._robots = report, planner, obstacles, robots

    def after(self, path: str, icon: Icon, base: KnownBase) -> KnownBase:
        """The base after an icon that contains no others."""
        if isinstance(icon, MbasePath):
            return self._along_path(path, icon, base)
        if isinstance(icon, MbaseTo):
            return self._straight_to(path, icon, base)
        if isinstance(icon, MbaseBy):
            return self._by(path, icon, base)
        if isinstance(icon, MbaseVelocity):
            return base.with_unknown_pose() if icon.ahead or icon.left or icon.turn else base
        if isinstance(icon, Gripper) and icon.action == "close":
            self._obstacles = self._obstacles.without(icon.object or "")
        if isinstance(icon, CooperativeIcon):
            if icon.moved:
                self._obstacles = self._obstacles.without(icon.moved)
            self._report.add_note(path, "the mission layer expands it at run time: not checked")
            return base.with_unknown_pose()
        return base

    def _along_path(self, path: str, icon: MbasePath, base: KnownBase) -> KnownBase:
        goal = Place(icon.floor, icon.x, icon.y)
        if self._planner:
            if not base.place:
                self._report.add_note(path, "the start of the drive is unknown: only its end is checked")
            elif not base.is_known:
                self._report.add_note(path, "the start of the drive is unknown: checked from the last known point")
            if self._path_m(path, base.place or goal, goal, RouteMode.SMOOTHED, "x, y") is None:
                return base.with_unknown_pose()
            self._note_robots(path, goal)
        return KnownBase(goal, icon.heading, is_known=True)

    def _straight_to(self, path: str, icon: MbaseTo, base: KnownBase) -> KnownBase:
        if not base.place or not base.is_known:
            self._note_unknown(path)
            return base.with_unknown_pose()
        goal = Place(base.place.floor, icon.x, icon.y)
        if not self._is_straight(path, base.place, goal, "x, y"):
            return base.with_unknown_pose()
        return KnownBase(goal, base.heading if icon.heading is None else icon.heading, is_known=True)

    def _by(self, path: str, icon: MbaseBy, base: KnownBase) -> KnownBase:
        heading = None if base.heading is None else base.heading + icon.turn
        if not (icon.ahead or icon.left):
            return replace(base, heading=heading)
        if not base.place or base.heading is None or not base.is_known:
            self._note_unknown(path)
            return base.with_unknown_pose()
        c, s = math.cos(base.heading), math.sin(base.heading)
        floor, x, y = base.place
        goal = Place(floor, x + c * icon.ahead - s * icon.left, y + s * icon.ahead + c * icon.left)
        if not self._is_straight(path, base.place, goal, "ahead, left"):
            return base.with_unknown_pose()
        return KnownBase(goal, heading, is_known=True)

    def _note_unknown(self, path: str) -> None:
        if self._planner:
            self._report.add_note(path, "the start of the drive is unknown: this drive is not checked")

    def _is_straight(self, path: str, start: Place, goal: Place, parameter: str) -> bool:
        """Whether the straight line is free; reports an obstacle. True without a planner."""
        if not self._planner:
            return True
        length_m = self._path_m(path, start, goal, RouteMode.GEOMETRIC, parameter)
        if length_m is None:
            return False
        if length_m > math.dist(start[1:], goal[1:]) + 0.01:  # [m]: the path goes around something
            line = f"from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f}) on {goal.floor}"
            ends = [(start.x, start.y), (goal.x, goal.y)]
            blocking = " and ".join(self._obstacles.near_line(goal.floor, ends, SMARTPAL_RADIUS_M)) or "an obstacle"
            self._report.add_finding(path, parameter, f"the straight line {line} is blocked by {blocking}")
            return False
        self._note_robots(path, goal)
        return True

    def _note_robots(self, path: str, goal: Place) -> None:
        for name in self._robots.near_line(goal.floor, [(goal.x, goal.y)], SMARTPAL_RADIUS_M):
            self._report.add_note(path, f"robot {name} stands at its target now")

    def _path_m(self, path: str, start: Place, goal: Place, mode: RouteMode, parameter: str) -> float | None:
        """Length of the path [m]; reports that there is none, and returns None."""
        assert self._planner
        request = self._obstacles.added_to(PathRequest(start, goal, mode=mode))
        try:
            return self._distance_m(self._planner, request)
        except PathError as planners:
            error = self._obstacles.explained(planners)
            if isinstance(error, UnknownFloor | InvalidPoint | NotFree) and error.which == "start" and start != goal:
                parameter = ""
            elif isinstance(error, UnknownFloor):
                parameter = "floor"
            self._report.add_finding(path, parameter, str(error))
            return None

    @staticmethod
    def _distance_m(planner: Planner, request: PathRequest) -> float:
        """Length of the path [m], which may begin where the robot touches an obstacle. Raises PathError."""
        try:
            return planner.paths(request)[0].distance
        except NotFree as error:
            if error.which != "start":
                raise
            with contextlib.suppress(PathError):
                return planner.paths(request._replace(radius=request.radius - CONTACT_M))[0].distance
            raise
