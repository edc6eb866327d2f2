"""The building's map as the console shows it: a plan of each floor, made again after an edit that concerns it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping

from robocorba.console.floor_plan import floor_plan
from robocorba.console.following import Following
from robocorba.console.operations import RESOLVE_TIMEOUT_S
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.corba.remote_map import RemoteMap
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb


class LivePlans(Following):
    """Floor plans of the map editor's building. Thread-safe.

    renamed: called with the present names of floors, by those that they had, when a name has gone."""

    def __init__(self, orb: Orb, changed: Callable[[], None], renamed: Callable[[Mapping[str, str]], None]) -> None:
        super().__init__("console map", 0.25, changed, "connecting")
        self._orb, self._renamed = orb, renamed
        self._lock = threading.Lock()
        self._map: RemoteMap | None = None
        self._building = Building("")
        self._plans: dict[str, tuple[Building, bytes]] = {}
        #: Version of the map; 0 before it is loaded.
        self.version = 0

    @property
    def building(self) -> Building:
        """The building of the last version; without floors before it is loaded."""
        return self._building

    def plan(self, floor: str) -> bytes:
        """The plan of a floor as JSON. Raises UnknownFloor."""
        building = self._building
        if floor not in building.floors:
            raise UnknownFloor("floor", floor, list(building.floors))
        with self._lock:
            kept = self._plans.get(floor)
            if kept is None or kept[0] is not building:
                kept = self._plans[floor] = building, json.dumps(floor_plan(building, floor)).encode()
            return kept[1]

    def _read_news(self) -> bool:
        try:
            if self._map is None:
                self._map = RemoteMap(self._orb, RESOLVE_TIMEOUT_S, with_topology=True)
            elif not self._map.follow():
                return False
            if self._building.floors.keys() - self._map.building.floors:
                self._renamed(self._map.lineage(self.version).floors(self._map.building.floors))
        except NotReachable:
            self._map = None
            raise
        self._building, self.version = self._map.building, self._map.version
        return True
