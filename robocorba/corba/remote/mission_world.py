"""What a leader knows of the running system when it plans: the map, where objects are, and ways."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely import Polygon

from robocorba.corba.orb import Orb
from robocorba.corba.remote.floors import RemoteDatabase
from robocorba.corba.remote.maps import RemoteMap
from robocorba.corba.remote.paths import RemotePlanner
from robocorba.errors.robots import MissionFailed
from robocorba.maps.geometry import Obstacle
from robocorba.maps.model import Building
from robocorba.maps.movable import movables
from robocorba.missions.surroundings import placed
from robocorba.missions.world import Thing
from robocorba.planning.request import Path, PathRequest
from robocorba.spatial.floor_update import WHOLE, BodyKind

FIND_LIMIT_S = 5.0


class RemoteWorld:
    """Asks anew each time. Everything raises NotReachable."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._database, self._planner = RemoteDatabase(orb, FIND_LIMIT_S), RemotePlanner(orb)
        self._map: RemoteMap | None = None

    def building(self) -> Building:
        """The map as it is now."""
        if self._map is None:
            self._map = RemoteMap(self._orb, FIND_LIMIT_S)
        else:
            self._map.follow()
        return self._map.building

    def thing(self, name: str) -> Thing:
        """Raises MissionFailed where there is no such object."""
        on_map = movables(self.building())
        for found in self._things():
            if found.name == name:
                height_m = on_map[name][0].height if name in on_map else 0.0
                return found._replace(height_m=height_m)
        known = ", ".join(sorted(found.name for found in self._things())) or "none"
        raise MissionFailed(f"there is no object {name[:80]!r} that can be carried; there are {known}")

    def others(self, thing: str) -> dict[str, list[Obstacle]]:
        """By floor, what else can be moved."""
        found: dict[str, list[Obstacle]] = {}
        for other in self._things():
            if other.name != thing:
                shape = placed(other.outline, (other.x, other.y, other.heading))
                found.setdefault(other.floor, []).append(Obstacle("object", other.name, shape))
        return found

    def paths(self, request: PathRequest) -> Sequence[Path]:
        """Raises PathError."""
        return self._planner.paths(request)

    def _things(self) -> list[Thing]:
        found = []
        for floor in self._database.floors():
            update = self._database.changes(floor, WHOLE)
            motions = {int(row["number"]): row for row in update.motions}
            for body in update.came:
                if body.kind is BodyKind.OBJECT and body.number in motions:
                    row = motions[body.number]
                    place = float(row["x"]), float(row["y"]), float(row["heading"])
                    outline = shapely.make_valid(Polygon(body.outline))
                    found.append(Thing(body.name, floor, *place, outline, body.mass_kg, 0.0))
        return found
