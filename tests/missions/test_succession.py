"""Which robot leads a mission when its leader is gone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.missions.succession import DEFAULT_POLICY, Succession, SuccessionPolicy
from robocorba.simulation.mission_record import MemberRecord, MissionContent, MissionResult
from robocorba.simulation.store import Mission
from tests.control.places import eventually

POLICY = SuccessionPolicy(turn_s=0.2, interval_s=0.01, limit_s=5.0)
MEMBERS = tuple(MemberRecord(robot, "helper") for robot in "BAC")
ICON: dict[str, Any] = {"icon": "move_table", "table": "desk"}
RECORD = MissionContent(kind="move_table", about="desk", leader="A", begun=1.0, icon=ICON, members=MEMBERS)


class Database:
    """One mission. is_away: it does not answer."""

    def __init__(self) -> None:
        self.content: MissionContent | None = RECORD
        self.is_away = False
        self.calls = 0

    def mission(self, name: str) -> Mission:
        self.calls += 1
        if self.is_away:
            raise NotReachable("the Omni database does not answer")
        if self.content is None:
            raise UnknownMission(name)
        return Mission(name, 1, self.content.encode())

    def put_mission(self, mission: Mission) -> int:
        raise AssertionError("the successor itself claims the mission")


class Robot:
    """A robot that takes over; the database then names it. refusals: how often it can't."""

    def __init__(self, name: str, database: Database) -> None:
        self.name, self._database = name, database
        self.is_busy, self.refusals = False, 0
        self.led: list[tuple[str, dict[str, Any]]] = []

    def can_lead(self, mission: str) -> bool:
        return not self.is_busy

    def lead(self, mission: str, icon: dict[str, Any], term: int) -> None:
        assert self._database.content and term == self._database.content.term
        if self.refusals:
            self.refusals -= 1
            raise IllegalOrder("lead a mission", "is stopped")
        self.led.append((mission, icon))
        assert self._database.content
        self._database.content = self._database.content.taken_over(self.name, "A was silent", 2.0)


class Scene:
    """Robots B and C, whose leader A is silent. living: leaders that answer."""

    def __init__(self, policy: SuccessionPolicy = POLICY) -> None:
        self.database = Database()
        self.robots = {name: Robot(name, self.database) for name in "BC"}
        self.living: set[str] = set()
        self._successions = {
            name: Succession(name, self.database, lambda leader, mission: leader in self.living, robot, policy)
            for name, robot in self.robots.items()
        }

    def begin(self, *robots: str) -> None:
        for name in robots:
            self._successions[name].begin("m", 1)

    def wait(self) -> None:
        for each in self._successions.values():
            eventually(lambda each=each: not each._waiting, "it is over")

    def leaders(self) -> list[str]:
        return [name for name, robot in self.robots.items() for _ in robot.led]


def test_the_first_member_leads_also_where_another_looked_before_it() -> None:
    scene = Scene(DEFAULT_POLICY)
    scene.begin("C")
    eventually(lambda: scene.database.calls >= 2, "C has looked twice: it is not its turn")
    scene.begin("B")
    scene.wait()
    assert scene.leaders() == ["B"]
    assert scene.robots["B"].led == [("m", ICON)]


def test_the_next_one_leads_if_the_first_is_gone() -> None:
    scene = Scene()
    scene.begin("C")
    scene.wait()
    assert scene.leaders() == ["C"]


def test_the_next_one_leads_if_the_first_is_busy() -> None:
    scene = Scene()
    scene.robots["B"].is_busy = True
    scene.begin("B", "C")
    scene.wait()
    assert scene.leaders() == ["C"]


def test_a_robot_that_can_t_lead_tries_again() -> None:
    scene = Scene()
    scene.robots["B"].refusals = 3
    scene.begin("B")
    scene.wait()
    assert scene.leaders() == ["B"]


def test_a_leader_that_answers_goes_on_leading() -> None:
    scene = Scene()
    scene.living = {"A"}
    scene.begin("B")
    eventually(lambda: scene.database.calls > 5, "it looks again and again")
    assert scene.leaders() == []
    scene.living = set()
    scene.wait()
    assert scene.leaders() == ["B"]


def test_it_waits_for_the_database() -> None:
    scene = Scene()
    scene.database.is_away = True
    scene.begin("B")
    eventually(lambda: scene.database.calls > 5, "it asks again and again")
    scene.database.is_away = False
    scene.wait()
    assert scene.leaders() == ["B"]


@pytest.mark.parametrize(
    "change",
    [
        lambda content: None,
        lambda content: replace(content, icon=None),
        lambda content: replace(content, members=()),
        lambda content: content.taken_over("C", "A was silent", 2.0),
        lambda content: content.ended_as(MissionResult.ABORTED, "it was aborted", 2.0),
    ],
)
def test_nobody_leads_what_needs_no_leader(change: Callable[[MissionContent], MissionContent | None]) -> None:
    scene = Scene()
    scene.database.content = change(RECORD)
    scene.begin("B")
    scene.wait()
    assert scene.leaders() == []


def test_it_gives_up() -> None:
    scene = Scene()
    scene.database.is_away = True
    succession = Succession(
        "B", scene.database, lambda leader, mission: False, scene.robots["B"], SuccessionPolicy(0.1, 0.01, 0.1)
    )
    succession.begin("m", 1)
    eventually(lambda: not succession._waiting, "it gives up")
    succession.close()
    succession.begin("m", 1)
    assert not succession._waiting
