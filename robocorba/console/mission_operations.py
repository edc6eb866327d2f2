"""Operations of the missions page: start, abort and report missions."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from robocorba.console.operations import RESOLVE_TIMEOUT_S
from robocorba.errors.services import NotReachable
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.orb.orb import Orb

Row = Mapping[str, Any]


class MissionOperations:
    """Operations of the missions page: start, abort and report missions.

    rows: returns the state of the system, as SystemState.rows."""

    def __init__(self, orb: Orb, rows: Callable[[], Row]) -> None:
        self._rows = rows
        self._control = RemoteMissionControl(orb, RESOLVE_TIMEOUT_S)

    def leaders(self) -> list[dict[str, Any]]:
        """The robots by name, each with its channel, whether it is free to lead a mission, and why it is not."""
        rows = self._rows()
        if rows["naming"] and not rows["robots"]:
            raise NotReachable(rows["naming"])
        return [_leader(name, row) for name, row in sorted(rows["robots"].items()) if row["bound"]]

    def start_mission(self, leader: str, icon: dict[str, Any]) -> str:
        """Let a robot lead the mission of a cooperative icon; returns the mission's name once it has accepted."""
        return self._control.start(leader, json.dumps(icon))

    def abort_mission(self, name: str) -> None:
        """Abort exactly this mission; returns when its leader has accepted it."""
        self._control.abort(name)

    def mission_report(self, name: str) -> dict[str, Any]:
        """The report of a mission; of one that runs or whose leader is gone, what is known."""
        return self._control.report(name)


def _leader(name: str, row: Row) -> dict[str, Any]:
    state = row["state"]
    if row["problem"] or not state:
        return {"robot": name, "channel": "", "free": False, "why": "does not answer"}
    # Robots of earlier releases do not tell their mission and channel.
    mission, channel = state.get("mission", ""), state.get("channel", "")
    if state["condition"] != "IDLE":
        why = state["display"]["text"]
    elif mission:
        why = f"is in mission {mission}"
    else:
        why = "" if channel else "has no event channel"
    return {"robot": name, "channel": channel, "free": not why, "why": why}
