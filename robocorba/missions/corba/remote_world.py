"""The state of the running system that a leader plans with: the map, the movable objects, and paths."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely import Polygon

from robocorba.errors.robots import MissionFailed
from robocorba.map_editor.corba.remote_map import RemoteMap
from robocorba.map_editor.geometry import Obstacle
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import movables, not_found
from robocorba.map_editor.spatial.floor_update import WHOLE, Body, BodyKind
from robocorba.missions.obstacles import placed
from robocorba.missions.world import MovableObject, StandingRobot
from robocorba.orb.orb import Orb
from robocorba.planning.corba.remote_planner import RemotePlanner
from robocorba.planning.request import Path, PathRequest
from robocorba.simulation.corba.remote_database import RemoteDatabase

#: Timeout to resolve a server [s].
RESOLVE_TIMEOUT_S = 5.0


class RemoteWorld:
    """Queries the servers on every call. Thread-safe. All methods raise NotReachable."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._database, self._planner = RemoteDatabase(orb, RESOLVE_TIMEOUT_S), RemotePlanner(orb)
        self._lock = threading.Lock()
        self._map: RemoteMap | None = None

    def building(self) -> Building:
        """The current map."""
        return self._current_map().building

    def _current_map(self) -> RemoteMap:
        with self._lock:
            if self._map is None:
                self._map = RemoteMap(self._orb, RESOLVE_TIMEOUT_S)
            else:
                self._map.follow()
            return self._map

    def movable(self, name: str) -> MovableObject:
        """A movable object by its name. Raises MissionFailed if it does not exist."""
        on_map = movables(self.building())
        for found in self._movables():
            if found.name == name:
                height_m = on_map[name][0].height if name in on_map else 0.0
                return found._replace(height_m=height_m)
        raise MissionFailed(not_found(name, [found.name for found in self._movables()]))

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        """All movable objects except `carried`, and open proposals, by floor."""
        found: dict[str, list[Obstacle]] = {}
        for seen in self._current_map().proposals():
            found.setdefault(seen.floor, []).append(Obstacle("object", seen.name, Polygon(seen.outline)))
        for other in self._movables():
            if other.name != carried:
                shape = placed(other.outline, (other.x, other.y, other.heading))
                found.setdefault(other.floor, []).append(Obstacle("object", other.name, shape))
        return found

    def robots(self) -> list[StandingRobot]:
        """All robots of the building, on whatever floor."""
        return [
            StandingRobot(body.name, floor, float(row["x"]), float(row["y"]), body.radius_m)
            for floor, body, row in self._bodies(BodyKind.ROBOT)
        ]

    def paths(self, request: PathRequest) -> Sequence[Path]:
        """Paths from the path planning agent. Raises PathError."""
        return self._planner.paths(request)

    def _movables(self) -> list[MovableObject]:
        found = []
        for floor, body, row in self._bodies(BodyKind.OBJECT):
            place = float(row["x"]), float(row["y"]), float(row["heading"])
            outline = shapely.make_valid(Polygon(body.outline))
            found.append(MovableObject(body.name, floor, *place, outline, body.mass_kg, 0.0))
        return found

    def _bodies(self, kind: BodyKind) -> Iterator[tuple[str, Body, np.void]]:
        """The floor, the body and its row of MOTION, of all bodies of this kind."""
        for floor in self._database.floors():
            update = self._database.changes(floor, WHOLE)
            motions = {int(row["number"]): row for row in update.motions}
            for body in update.came:
                if body.kind is kind and body.number in motions:
                    yield floor, body, motions[body.number]
