"""Servant of the Omni database."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from omniORB import CORBA

from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.simulation.corba import floors, scans, sessions
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.simulation.store import Mission
from robocorba.stubs import RoboCorba, RoboCorba__POA


class OmniDatabaseServant(ServerServant, RoboCorba__POA.OmniDatabase):
    """RoboCorba::OmniDatabase, with the building's missions."""

    def __init__(
        self, database: OmniDatabase, missions: MissionDirectory, publish_typed: Callable[[str], float]
    ) -> None:
        self._database, self._missions, self._publish_typed = database, missions, publish_typed

    def floors(self) -> list[str]:
        return self._database.floors

    @translating
    def getFloor(self, name: str) -> Any:
        return floors.update(self._database.floor(name))

    @translating
    def floorChanges(self, name: str, since: int) -> Any:
        return floors.update(self._database.changes(name, since))

    @translating
    def typedFloorChanges(self, name: str, since: int) -> Any:
        return floors.typed_update(self._database.changes(name, since))

    @translating
    def publishTypedChanges(self, name: str) -> float:
        self._database.check(name)
        return self._publish_typed(name)

    @translating
    def lastScans(self, name: str) -> list[Any]:
        return [scans.last_scan(scan) for scan in self._database.last_scans(name)]

    @translating
    def scansSince(self, name: str, since: float) -> list[Any]:
        return [scans.robot_scan(scan) for scan in self._database.scans_since(name, since)]

    @translating
    def postures(self, name: str, since: float) -> list[Any]:
        return [sessions.posture(posture) for posture in self._database.postures(name, since)]

    def reservations(self) -> list[Any]:
        return [sessions.reserved_areas(reserved) for reserved in self._database.reservations()]

    def elevators(self) -> list[Any]:
        return floors.elevators(self._database.elevators())

    @translating
    def putMission(self, mission: Any) -> int:
        return self._missions.put_mission(Mission(mission.name, mission.current, mission.document))

    def bound_to(self, robot: str) -> dict[str, Callable[..., Any]]:
        """What a robot with a file of its own calls instead: it stores the missions that it leads, or takes over."""

        def put_mission(mission: Any) -> int:
            if not self._missions.may_put(robot, mission.name, mission.document):
                raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)
            return int(self.putMission(mission))

        return {"putMission": put_mission}

    @translating
    def missions(self) -> list[Any]:
        return [_record(mission) for mission in self._missions.missions()]

    @translating
    def mission(self, name: str) -> Any:
        return _record(self._missions.stored(name))

    removeMission = forwarded("_missions", MissionDirectory.remove_mission)


def _record(mission: Mission) -> Any:
    return RoboCorba.MissionRecord(mission.name, mission.version, mission.document)
