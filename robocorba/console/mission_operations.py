"""Operations of the missions page: start, abort and report missions."""

from __future__ import annotations

import contextlib
import json
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

from robocorba.control.agent import AgentCondition
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent, robots
from robocorba.corba.remote.mission_control import RemoteMissionControl
from robocorba.errors.base import RoboCorbaError

#: Timeout to find a robot, and for the answers of all robots [s].
RESOLVE_TIMEOUT_S, ANSWERS_LIMIT_S = 1.0, 1.5
#: Robots asked at the same time.
THREADS = 32


class MissionOperations:
    """Operations of the missions page: start, abort and report missions."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._control = RemoteMissionControl(orb, RESOLVE_TIMEOUT_S)

    def leaders(self) -> list[dict[str, Any]]:
        """The robots by name, each with its channel, whether it is free to lead a mission, and why it is not."""
        names = robots(self._orb)
        threads = ThreadPoolExecutor(THREADS, "leaders")
        try:
            found = {name: threads.submit(self._leader, name) for name in names}
            wait(found.values(), ANSWERS_LIMIT_S)
            return [_answer(name, future) for name, future in found.items()]
        finally:
            threads.shutdown(wait=False, cancel_futures=True)

    def start_mission(self, leader: str, icon: dict[str, Any]) -> str:
        """Let a robot lead the mission of a cooperative icon; returns the mission's name once it has accepted."""
        return self._control.start(leader, json.dumps(icon))

    def abort_mission(self, name: str) -> None:
        """Abort exactly this mission; returns when its leader has accepted it."""
        self._control.abort(name)

    def mission_report(self, name: str) -> dict[str, Any]:
        """The report of a mission; of one that runs or whose leader is gone, what is known."""
        return self._control.report(name)

    def _leader(self, name: str) -> dict[str, Any]:
        agent = RemoteAgent(self._orb, name, RESOLVE_TIMEOUT_S)
        state, mission, channel = agent.state(), agent.mission(), agent.channel()
        if state.condition is AgentCondition.STOPPED:
            why = f"is stopped: {state.reason}"
        elif mission:
            why = f"is in mission {mission}"
        elif state.condition is not AgentCondition.IDLE:
            why = "runs a program"
        else:
            why = "" if channel else "has no event channel"
        return {"robot": name, "channel": channel, "free": not why, "why": why}


def _answer(name: str, future: Future[dict[str, Any]]) -> dict[str, Any]:
    """The row of a robot that may not have answered."""
    if future.done():
        with contextlib.suppress(RoboCorbaError):
            return future.result()
    return {"robot": name, "channel": "", "free": False, "why": "does not answer"}
