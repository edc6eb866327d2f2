"""Servant of the path planning agent."""

from __future__ import annotations

from typing import Any

from robocorba.orb.exceptions import translating
from robocorba.orb.server_release import ServerServant
from robocorba.planning.corba import paths
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import PathRequest
from robocorba.stubs import RoboCorba__POA


class PathPlannerServant(ServerServant, RoboCorba__POA.PathPlanner):
    """RoboCorba::PathPlanner for a planner of the domain."""

    def __init__(self, planner: PathPlanner) -> None:
        self._planner = planner

    @translating
    def getPath(self, start: Any, goal: Any) -> list[Any]:
        path = self._planner.shortest(paths.place_of(start), paths.place_of(goal))
        return paths.path_points(path)

    def defaultRequest(self, start: Any, goal: Any) -> Any:
        return paths.request(PathRequest(paths.place_of(start), paths.place_of(goal)))

    @translating
    def findPaths(self, request: Any) -> list[Any]:
        return [paths.path(path) for path in self._planner.paths(paths.request_of(request))]

    def _get_mapVersion(self) -> int:
        return self._planner.version
