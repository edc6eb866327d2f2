"""Servant of the path planning agent."""

from __future__ import annotations

from typing import Any

from robocorba import conversion
from robocorba.conversion import translating
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import PathRequest
from robocorba.stubs import RoboCorba__POA


class PathPlannerServant(RoboCorba__POA.PathPlanner):
    """RoboCorba::PathPlanner on a planner of the domain."""

    def __init__(self, planner: PathPlanner) -> None:
        self._planner = planner

    @translating
    def getPath(self, start: Any, goal: Any) -> list[Any]:
        path = self._planner.shortest(conversion.place_of(start), conversion.place_of(goal))
        return conversion.path_points(path)

    def defaultRequest(self, start: Any, goal: Any) -> Any:
        return conversion.request(PathRequest(conversion.place_of(start), conversion.place_of(goal)))

    @translating
    def findPaths(self, request: Any) -> list[Any]:
        return [conversion.path(path) for path in self._planner.paths(conversion.request_of(request))]

    def _get_mapVersion(self) -> int:
        return self._planner.version
