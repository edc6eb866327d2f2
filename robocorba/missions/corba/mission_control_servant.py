"""Servant of mission control."""

from __future__ import annotations

from typing import Any

from robocorba.missions.corba import missions
from robocorba.missions.mission_control import MissionControl
from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.stubs import RoboCorba__POA


class MissionControlServant(ServerServant, RoboCorba__POA.MissionControl):
    """RoboCorba::MissionControl."""

    def __init__(self, control: MissionControl) -> None:
        self._control = control

    def missionsSince(self, version: int) -> list[Any]:
        return [missions.mission_state(state) for state in self._control.missions.since(version)]

    @translating
    def mission(self, name: str) -> Any:
        return missions.mission_state(self._control.missions.mission(name))

    @translating
    def leaders(self, name: str) -> list[Any]:
        return missions.leaders(self._control.missions.mission(name).content)

    start = forwarded("_control", MissionControl.start)
    abort = forwarded("_control", MissionControl.abort)

    @translating
    def report(self, name: str) -> str:
        return self._control.missions.report(name)
