"""Client of the Omni database, and copies of its floors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import FloorUpdate, FloorView
from robocorba.map_editor.spatial.posture import Posture
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject, translated
from robocorba.simulation.corba import floors, scans, sessions
from robocorba.simulation.reservations import ReservedAreas
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.store import Mission
from robocorba.stubs import RoboCorba

#: Timeout of a call to the database [s].
CALL_TIMEOUT_S = 2.0


def changes(database: Any, floor: str, since: int) -> FloorUpdate:
    """Changes of a floor since a version in a RoboCorba::OmniDatabase. Raises UnknownFloor, NotReachable."""
    with translated("the Omni database"):
        return floors.update_of(database.floorChanges(floor, since))


class RemoteDatabase:
    """The Omni database of a running system, resolved by the first call and after each failure. Thread-safe.

    resolve_timeout_s: timeout to resolve it [s]."""

    def __init__(self, orb: Orb, resolve_timeout_s: float) -> None:
        timeouts = resolve_timeout_s, CALL_TIMEOUT_S
        self._database = RemoteObject(orb, "OmniDatabase", RoboCorba.OmniDatabase, "the Omni database", *timeouts)

    def floors(self) -> list[str]:
        """Names of all floors. Raises NotReachable."""
        return list(self._database.call(lambda database: database.floors()))

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """Changes of a floor since a version. Raises UnknownFloor, NotReachable."""
        return self._database.call(lambda database: changes(database, floor, since))

    def scans_since(self, floor: str, time_s: float) -> list[RobotScan]:
        """Scans on a floor after a simulated time [s], the last one of each sensor.

        Raises UnknownFloor, NotReachable."""
        return self._database.call(lambda to: [scans.robot_scan_of(scan) for scan in to.scansSince(floor, time_s)])

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        """Postures that robots on a floor reported after a simulated time [s]. Raises UnknownFloor, NotReachable."""
        return [sessions.posture_of(found) for found in self._database.call(lambda to: to.postures(floor, time_s))]

    def reservations(self) -> list[ReservedAreas]:
        """All reservations of areas, granted or waiting. Raises NotReachable."""
        return [sessions.reserved_areas_of(record) for record in self._database.call(lambda to: to.reservations())]

    def mission(self, name: str) -> Mission:
        """A mission. Raises UnknownMission, NotReachable."""
        record = self._database.call(lambda database: database.mission(name))
        return Mission(record.name, record.current, bytes(record.document))

    def missions(self) -> dict[str, Mission]:
        """All missions by name. Raises NotReachable."""
        records = self._database.call(lambda database: database.missions())
        return {each.name: Mission(each.name, each.current, bytes(each.document)) for each in records}

    def put_mission(self, mission: Mission) -> int:
        """Store a mission; return its new version. Raises InvalidMission, StaleMission, NotReachable."""
        record = RoboCorba.MissionRecord(mission.name, mission.version, mission.document)
        return int(self._database.call(lambda database: database.putMission(record)))

    def set_resolve_timeout(self, timeout_s: float) -> None:
        self._database.resolve_timeout_s = timeout_s


class RemoteFloors:
    """Local copies of floors of a running system, by default all; reconnects after a failure. Not thread-safe."""

    def __init__(self, orb: Orb, chosen: Sequence[str] = ()) -> None:
        self._database, self._chosen = RemoteDatabase(orb, 0.0), chosen
        #: Copies by name.
        self.views: dict[str, FloorView] = {}

    def follow(self, resolve_timeout_s: float) -> list[FloorUpdate]:
        """Update all views. After a failure the next call loads whole floors again.

        Raises UnknownFloor, and NotReachable if the database is not found within `resolve_timeout_s`."""
        self._database.set_resolve_timeout(resolve_timeout_s)
        try:
            names = self._chosen or self._database.floors()
            before, self.views = self.views, {}
            return [update for name in names for update in self._updates(before.get(name) or FloorView(name))]
        except NotReachable:
            self.views = {}
            raise

    def _updates(self, view: FloorView) -> list[FloorUpdate]:
        """The update of a floor; none if it has been removed or renamed since the names were read."""
        try:
            update = self._database.changes(view.floor, view.version)
        except UnknownFloor:
            if view.floor in self._chosen:
                raise
            return []
        view.apply(update)
        self.views[view.floor] = view
        return [update]
