"""Observes missions from outside: the leaders that robots obey, how they move, and what touches what."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Collection, Iterator
from typing import NamedTuple

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.missions.messages import MemberState, message_of
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.missions import MissionSystem
from testkit.simulation import RemoteFloor

#: Interval between looks at the floors [s].
LOOK_S = 0.04
#: Speed above which a robot drives [m/s].
DRIVES_M_S = 0.05
#: Time in which the states of a former leader's members may still arrive [s].
LATE_S = 2.0


class Seen(NamedTuple):
    """The speeds of robots [m/s] at a time of this process's clock [s]."""

    at: float
    speeds: dict[str, float]


class Obeyed(NamedTuple):
    """A robot reports that it has begun a step of an attempt at a mission, at a time of its clock. number: of the
    attempt."""

    at: float
    robot: str
    mission: str
    number: int
    leader: str
    step: int


class Witness:
    """Use it in a `with`. channel: at which it listens to all events."""

    def __init__(self, place: MissionSystem, channel: str = "lab") -> None:
        self._place, self._channel = place, channel
        self._stack = contextlib.ExitStack()
        self._lock = threading.Lock()
        self._floors: list[RemoteFloor] = []
        self._seen: list[Seen] = []
        self._obeyed: list[Obeyed] = []
        self._steps: dict[tuple[str, str], int] = {}
        #: Pairs that touched each other, and robots that lost their grip.
        self.touched: list[str] = []
        self.grips_lost: list[str] = []

    def __enter__(self) -> Witness:
        with contextlib.ExitStack() as stack:
            events = stack.enter_context(EventClient(self._place.orb, self._channel))
            events.subscribe(self._on_state, "mission.state")
            events.subscribe(self._on_collision, "simulation.collision")
            events.subscribe(self._on_grip_lost, "simulation.grip_lost")
            stack.enter_context(contextlib.closing(Repeating("witness", self._look, LOOK_S).start()))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    # ---- findings ----

    def blindness(self) -> list[str]:
        """What it has not observed although a mission was done."""
        with self._lock:
            was_moving = any(speed > DRIVES_M_S for one in self._seen for speed in one.speeds.values())
            return [*([] if self._obeyed else ["no steps were observed"]), *([] if was_moving else ["no robot moved"])]

    def disobedience(self) -> list[str]:
        """Steps that robots began for a leader although another had begun to lead them, in the same attempt or in a
        later one."""
        with self._lock:
            obeyed = list(self._obeyed)
        first_at: dict[tuple[str, int, str], float] = {}
        for one in obeyed:
            first_at.setdefault((one.mission, one.number, one.leader), one.at)

        def reign(one: Obeyed) -> tuple[int, float]:
            return one.number, first_at[one.mission, one.number, one.leader]

        wrong: list[str] = []
        for one in obeyed:
            for other in obeyed:
                is_later = other.mission == one.mission and other.leader != one.leader and reign(other) > reign(one)
                late_s = 0.0 if other.robot == one.robot else LATE_S
                if is_later and one.at > other.at + late_s:
                    wrong.append(f"{one.robot} obeyed {one.leader} after {other.robot} obeyed {other.leader}")
        return list(dict.fromkeys(wrong))

    def drove_on_s(self, robots: Collection[str], since: float) -> float:
        """Time after `since` for which one of the robots drove without a pause [s]."""
        with self._lock:
            seen = [one for one in self._seen if one.at >= since]
        longest_s = 0.0
        for robot in robots:
            for one in seen:
                if one.speeds.get(robot, 0.0) < DRIVES_M_S:
                    break
                longest_s = max(longest_s, one.at - since)
        return longest_s

    def drivers(self, since: float, until: float) -> set[str]:
        """The robots and objects that moved in this time [s]."""
        with self._lock:
            seen = [one for one in self._seen if since <= one.at <= until]
        return {name for one in seen for name, speed in one.speeds.items() if speed > DRIVES_M_S}

    # ---- what it sees ----

    def _look(self) -> None:
        try:
            if not self._floors:
                self._floors = list(self._new_floors())
            for floor in self._floors:
                floor.follow()
        except (RoboCorbaError, CORBA.Exception):  # the server is being restarted
            self._floors = []
            return
        speeds: dict[str, float] = {}
        for floor in self._floors:
            for row in floor.view.motions:
                name = floor.view.bodies[int(row["number"])].name
                speeds[name] = math.hypot(float(row["vx"]), float(row["vy"]))
        with self._lock:
            self._seen.append(Seen(time.monotonic(), speeds))

    def _new_floors(self) -> Iterator[RemoteFloor]:
        database = self._place.orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        for floor in RemoteDatabase(self._place.orb, 5.0).floors():
            yield RemoteFloor(database, floor)

    def _on_state(self, event: Event) -> None:
        state = message_of(event.type, event.payload)
        if not isinstance(state, MemberState) or state.has_left or state.failure or state.step < 0:
            return
        with self._lock:
            if self._steps.get((state.robot, state.mission), -1) >= state.step:
                return
            self._steps[state.robot, state.mission] = state.step
            number = int(state.mission.rpartition(".")[2])
            self._obeyed.append(Obeyed(state.sent, state.robot, state.of, number, state.leader, state.step))

    def _on_collision(self, event: Event) -> None:
        self.touched.append(" and ".join(event.payload["who"]))

    def _on_grip_lost(self, event: Event) -> None:
        self.grips_lost.append(" and ".join(event.payload["who"]))
