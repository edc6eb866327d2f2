"""A World that consists of a map only."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.robots import MissionFailed
from robocorba.map_editor.geometry import Obstacle, object_geometry
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import movables, object_outline
from robocorba.map_editor.polygons import FloorArea
from robocorba.missions.world import MovableObject, StandingRobot
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathRequest


def first_way(alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
    """Reserve the first one of several ways."""
    return 0


class MapWorld:
    """Objects are at their places on the map; each has the same mass. standing: the robots."""

    def __init__(self, building: Building, mass_kg: float = 2.0, standing: Sequence[StandingRobot] = ()) -> None:
        self.standing = list(standing)
        self._building, self._mass_kg = building, mass_kg
        self._planner = PathPlanner(building)

    def building(self) -> Building:
        return self._building

    def movable(self, name: str) -> MovableObject:
        known = movables(self._building)
        if name not in known:
            raise MissionFailed(f"there is no object {name!r}")
        entry, floor = known[name]
        return MovableObject(name, floor, *entry.at, entry.heading, object_outline(entry), self._mass_kg, entry.height)

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        found: dict[str, list[Obstacle]] = {}
        for name, (entry, floor) in movables(self._building).items():
            if name != carried:
                found.setdefault(floor, []).append(Obstacle("object", name, object_geometry(entry)))
        return found

    def robots(self) -> list[StandingRobot]:
        return self.standing

    def paths(self, request: PathRequest) -> Sequence[Path]:
        return self._planner.paths(request)
