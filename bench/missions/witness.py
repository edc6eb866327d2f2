"""Observes missions from outside: the leaders that robots obey, how they move, and what touches what."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Collection
from functools import partial
from typing import NamedTuple

from omniORB import CORBA

from bench.common.harness import sampled
from robocorba.errors.base import RoboCorbaError
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.missions.messages import MemberState, message_of
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.stubs import RoboCorba
from testkit.missions import MissionSystem
from testkit.simulation import RemoteFloor

#: Interval between looks at the floors [s].
LOOK_S = 0.04
#: Speed above which a robot drives [m/s].
DRIVES_M_S = 0.05
#: Time in which the states of a former leader's members may still arrive [s].
LATE_S = 2.0


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
        self._floors: list[RemoteFloor] = []
        #: Robots and objects that drive at a time [s].
        self._seen: list[tuple[float, set[str]]] = []
        self._obeyed: list[Obeyed] = []
        #: Pairs that touched each other, and robots that lost their grip.
        self.touched: list[str] = []
        self.grips_lost: list[str] = []

    def __enter__(self) -> Witness:
        events = self._stack.enter_context(EventClient(self._place.orb, self._channel))
        events.subscribe(self._on_state, "mission.state")
        events.subscribe(partial(_note, self.touched), "simulation.collision")
        events.subscribe(partial(_note, self.grips_lost), "simulation.grip_lost")
        self._seen = self._stack.enter_context(sampled(self._drivers_now, LOOK_S))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    # ---- findings ----

    def blindness(self) -> list[str]:
        """What it has not observed although a mission was done."""
        was_moving = any(drivers for _, drivers in list(self._seen))
        return [*([] if self._obeyed else ["no steps were observed"]), *([] if was_moving else ["no robot moved"])]

    def disobedience(self) -> list[str]:
        """Steps that robots began for a leader although another had begun to lead them, in the same attempt or in a
        later one."""
        obeyed = list(self._obeyed)
        first_at: dict[tuple[str, int, str], float] = {}
        for one in obeyed:
            first_at.setdefault((one.mission, one.number, one.leader), one.at)

        def reign(one: Obeyed) -> tuple[int, float]:
            return one.number, first_at[one.mission, one.number, one.leader]

        wrong: list[str] = []
        for one, other in itertools.permutations(obeyed, 2):
            is_later = other.mission == one.mission and other.leader != one.leader and reign(other) > reign(one)
            late_s = 0.0 if other.robot == one.robot else LATE_S
            if is_later and one.at > other.at + late_s:
                wrong.append(f"{one.robot} obeyed {one.leader} after {other.robot} obeyed {other.leader}")
        return list(dict.fromkeys(wrong))

    def drove_on_s(self, robots: Collection[str], since: float) -> float:
        """Time after `since` for which one of the robots drove without a pause [s]."""
        longest_s, seen = 0.0, [look for look in list(self._seen) if look[0] >= since]
        for robot in robots:
            for at, drivers in seen:
                if robot not in drivers:
                    break
                longest_s = max(longest_s, at - since)
        return longest_s

    def drivers(self, since: float, until: float) -> set[str]:
        """The robots and objects that moved in this time [s]."""
        return set().union(*(drivers for at, drivers in list(self._seen) if since <= at <= until))

    # ---- what it sees ----

    def _drivers_now(self) -> set[str]:
        try:
            if not self._floors:
                database = self._place.orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
                self._floors = [RemoteFloor(database, floor) for floor in RemoteDatabase(self._place.orb, 5.0).floors()]
            for floor in self._floors:
                floor.follow()
        except (RoboCorbaError, CORBA.Exception):  # the server is being restarted
            self._floors = []
            return set()
        return {
            floor.view.bodies[int(row["number"])].name
            for floor in self._floors
            for row in floor.view.motions
            if math.hypot(float(row["vx"]), float(row["vy"])) > DRIVES_M_S
        }

    def _on_state(self, event: Event) -> None:
        state = message_of(event.type, event.payload)
        if not isinstance(state, MemberState) or state.has_left or state.failure or state.step < 0:
            return
        number = int(state.mission.rpartition(".")[2])
        one = Obeyed(state.sent, state.robot, state.of, number, state.leader, state.step)
        if not any(other.step >= one.step for other in self._obeyed if other[1:4] == one[1:4]):
            self._obeyed.append(one)


def _note(found: list[str], event: Event) -> None:
    found.append(" and ".join(event.payload["who"]))
