"""Client of mission control: the missions of the building, wherever they were started."""

from __future__ import annotations

import json
from typing import Any

from robocorba.missions.corba import missions
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.simulation.mission_record import LeaderRecord, MissionState
from robocorba.stubs import RoboCorba

#: Timeout of a call [s]. A start waits until the leader has checked the icon.
CALL_TIMEOUT_S, START_TIMEOUT_S = 5.0, 15.0


class RemoteMissionControl:
    """Mission control of a running system, resolved by the first call and after each failure. Thread-safe.

    resolve_timeout_s: timeout to resolve it [s]. All methods raise NotReachable."""

    def __init__(self, orb: Orb, resolve_timeout_s: float = 3.0) -> None:
        def remote(call_timeout_s: float) -> RemoteObject:
            timeouts = resolve_timeout_s, call_timeout_s
            return RemoteObject(orb, "MissionControl", RoboCorba.MissionControl, "mission control", *timeouts)

        self._control, self._patient_control = remote(CALL_TIMEOUT_S), remote(START_TIMEOUT_S)

    def missions_since(self, version: int) -> list[MissionState]:
        """The missions that changed after a version, oldest change first; with 0 all that are kept."""
        structs = self._control.call(lambda control: control.missionsSince(version))
        return [missions.mission_state_of(struct) for struct in structs]

    def mission(self, name: str) -> MissionState:
        """Raises UnknownMission."""
        return missions.mission_state_of(self._control.call(lambda control: control.mission(name)))

    def leaders(self, name: str) -> list[LeaderRecord]:
        """Those that have led a mission, the last one last. Raises UnknownMission."""
        return [missions.leader_of(struct) for struct in self._control.call(lambda control: control.leaders(name))]

    def start(self, leader: str, icon: str) -> str:
        """Let a robot lead the mission of a cooperative icon in JSON, without a name the nearest free one; return the
        mission's name. Raises InvalidProgram, IllegalOrder, NoLeader."""
        return str(self._patient_control.call(lambda control: control.start(leader, icon)))

    def abort(self, name: str) -> None:
        """Abort a mission; returns when its leader has accepted it. Raises UnknownMission, NoLeader."""
        self._patient_control.call(lambda control: control.abort(name))

    def report(self, name: str) -> dict[str, Any]:
        """The report of a mission; see docs/mission.md. Raises UnknownMission."""
        report: dict[str, Any] = json.loads(self._control.call(lambda control: control.report(name)))
        return report
