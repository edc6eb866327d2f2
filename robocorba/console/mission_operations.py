"""Operations of the missions page: plan, start, abort and report missions."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from robocorba.console.arguments import NotPossible
from robocorba.console.operations import RESOLVE_TIMEOUT_S
from robocorba.errors.paths import PathError
from robocorba.errors.robots import GoalReached, InvalidPlan, RobotError
from robocorba.errors.services import NotReachable
from robocorba.missions.cooperative_planner import MakePlanner
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.missions.corba.remote_world import RemoteWorld
from robocorba.missions.party import party_of
from robocorba.missions.world import World
from robocorba.orb.orb import Orb
from robocorba.planning.request import Place
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs.icons import Icon
from robocorba.robot.programs.program import of_icon
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.mission_record import decoded

Row = Mapping[str, Any]
Answer = dict[str, Any]


class MissionOperations:
    """Operations of the missions page: plan, start, abort and report missions.

    rows: returns the state of the system, as SystemState.rows. planner_of: what makes the planner of a cooperative
    icon; raises MissionFailed. world: by default that of the running system."""

    def __init__(
        self, orb: Orb, rows: Callable[[], Row], planner_of: Callable[[Any], MakePlanner], world: World | None = None
    ) -> None:
        self._rows, self._planner_of = rows, planner_of
        self._control = RemoteMissionControl(orb, RESOLVE_TIMEOUT_S)
        self._records = RemoteDatabase(orb, RESOLVE_TIMEOUT_S)
        self._world, self._lock = world or RemoteWorld(orb), threading.Lock()
        #: The last party that was planned, and in which situation: that a carry is impossible is found in seconds.
        self._planned: tuple[object, Answer] = None, {}

    def leaders(self) -> list[Answer]:
        """The robots by name, each with its channel, whether it is free to lead a mission, and why it is not."""
        rows = self._rows()
        if rows["naming"] and not rows["robots"]:
            raise NotReachable(rows["naming"])
        return [_leader(name, row) for name, row in sorted(rows["robots"].items()) if row["bound"]]

    def mission_party(self, leader: str, icon: Answer, with_busy: bool = False) -> Answer:
        """Who would come if the mission of a cooperative icon began now: `robots`, the leader first, none if nothing is
        to be done, and those that would be asked to step `aside`; or the `reason` why it can't begin. An empty leader:
        the nearest free robot. with_busy: as if all robots were free."""
        rows = self._rows()["robots"]
        names = [each["robot"] for each in self.leaders() if each["free"] or (with_busy and each["channel"])]
        states = {name: rows[name]["state"]["at"] for name in names}
        free = {name: Place(at["floor"], at["x"], at["y"]) for name, at in states.items()}
        return self._party(of_icon(json.dumps(icon)).icons[0], leader, free)

    def _party(self, icon: Icon, leader: str, places: Mapping[str, Place]) -> Answer:
        with self._alone():
            situation = icon, leader, places, self._world.building(), self._world.others("")
            if situation != self._planned[0]:
                self._planned = situation, self._plan(icon, leader, places)
            return self._planned[1]

    def _plan(self, icon: Icon, leader: str, places: Mapping[str, Place]) -> Answer:
        try:
            make = self._planner_of(icon)
            robots, aside = party_of(lambda name, here: make(icon, self._world, name, here), places, leader)
            return {"robots": robots, "aside": aside}
        except GoalReached:
            return {"robots": [], "aside": []}
        except InvalidPlan as error:
            return {"reason": error.reason}  # operators don't know the field of the plan
        except (RobotError, PathError) as error:
            return {"reason": str(error)}

    def object_place(self, name: str) -> Answer:
        """Where a movable object is now: `floor`, `x` and `y` [m]. Raises MissionFailed."""
        found = self._world.movable(name)
        return {"floor": found.floor, "x": found.x, "y": found.y}

    def start_mission(self, leader: str, icon: Answer) -> str:
        """Let a robot lead the mission of a cooperative icon; returns the mission's name once it has accepted."""
        return self._control.start(leader, json.dumps(icon))

    def mission_icon(self, name: str) -> Answer:
        """The cooperative icon of a mission, to start it again. Raises UnknownMission."""
        content = decoded(self._records.mission(name).document)
        if content is None or content.icon is None:
            raise NotPossible("its record does not say any more what it was to do")
        return content.icon

    def abort_mission(self, name: str) -> None:
        """Abort exactly this mission; returns when its leader has accepted it."""
        self._control.abort(name)

    def mission_report(self, name: str) -> Answer:
        """The report of a mission; of one that runs or whose leader is gone, what is known."""
        return self._control.report(name)

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Missions are planned one after another. Raises NotPossible after 20 s."""
        if not self._lock.acquire(timeout=20.0):
            raise NotPossible("other missions are being planned; try again in a few seconds")
        try:
            yield
        finally:
            self._lock.release()


def _leader(name: str, row: Row) -> Answer:
    state = row["state"]
    if row["problem"] or not state:
        return {"robot": name, "channel": "", "free": False, "why": "does not answer"}
    # Robots of earlier releases do not tell their mission and channel. Without arms it takes part in none.
    mission, has_arms = state.get("mission", ""), len(state["actor"]["joints"]) == len(JOINTS)
    channel = state.get("channel", "") if has_arms else ""
    if state["condition"] != "IDLE":
        why = state["display"]["text"]
    elif mission:
        why = "is in a mission"
    else:
        why = "" if channel else "has no event channel" if has_arms else "does not have SmartPal's arms"
    return {"robot": name, "channel": channel, "free": not why, "why": why}
