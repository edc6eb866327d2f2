"""Which robot leads a mission when its leader is gone, and when."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from msgspec.structs import replace

from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.missions import succession
from robocorba.missions.member import DEFAULT_POLICY
from robocorba.missions.succession import Succession
from robocorba.simulation.mission_record import MemberRecord, MissionContent, MissionResult
from robocorba.simulation.store import Mission
from tests.missions.virtual_time import VirtualTime

MEMBERS = tuple(MemberRecord(robot, "helper") for robot in "BAC")
ICON: dict[str, Any] = {"icon": "move_table", "table": "desk"}
RECORD = MissionContent(kind="move_table", about="desk", leader="A", begun=1.0, icon=ICON, members=MEMBERS)


class Scene:
    """Robots B and C, whose leader A is silent, and the database with their mission."""

    def __init__(self, time: VirtualTime) -> None:
        self.time = time
        self.content: MissionContent | None = RECORD
        #: Whether the database does not answer, leaders that do, robots that are busy, and how often one can't lead.
        self.is_away, self.living, self.busy, self.refusals = False, "", "", 0
        #: Who has taken the mission over, and when [s].
        self.led: list[tuple[str, float]] = []
        self.successions = {name: Succession(name, self, self.leads, Robot(name, self)) for name in "BC"}

    def begin(self, *robots: str) -> None:
        for name in robots:
            self.successions[name].begin("m", 1)

    def leads(self, leader: str, mission: str) -> bool:
        return leader in self.living

    def mission(self, name: str) -> Mission:
        if self.is_away:
            raise NotReachable("the Omni database does not answer")
        if self.content is None:
            raise UnknownMission(name)
        return Mission(name, 1, self.content.encode())

    def put_mission(self, mission: Mission) -> int:
        raise AssertionError("the successor itself claims the mission")


class Robot:
    """A robot that takes over; the database then names it."""

    def __init__(self, name: str, scene: Scene) -> None:
        self._name, self._scene = name, scene

    def can_lead(self, mission: str) -> bool:
        return self._name not in self._scene.busy

    def lead(self, mission: str, icon: dict[str, Any], term: int) -> None:
        scene = self._scene
        assert scene.content and (mission, icon, term) == ("m", ICON, scene.content.term)
        if scene.refusals:
            scene.refusals -= 1
            raise IllegalOrder("lead a mission", "is stopped")
        scene.led.append((self._name, scene.time.now))
        scene.content = scene.content.taken_over(self._name, "A was silent", 2.0)


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    time = VirtualTime()
    time.install(monkeypatch, succession)
    yield Scene(time)
    time.close()


@pytest.mark.parametrize(
    ("robots", "busy", "refusals", "led"),
    [
        ("CB", "", 0, ("B", 0.0)),  # in the order of the record
        ("C", "", 0, ("C", DEFAULT_POLICY.turn_s)),
        ("BC", "B", 0, ("C", DEFAULT_POLICY.turn_s)),
        ("B", "", 3, ("B", 3 * DEFAULT_POLICY.record_interval_s)),
    ],
)
def test_members_lead_in_turn(scene: Scene, robots: str, busy: str, refusals: int, led: tuple[str, float]) -> None:
    scene.busy, scene.refusals = busy, refusals
    scene.begin(*robots)
    scene.time.run_for(30.0)
    assert scene.led == [led]


def test_they_wait_for_a_leader_that_answers_and_for_the_database(scene: Scene) -> None:
    scene.living = "A"
    scene.begin("B")
    scene.time.run_for(10.0)
    scene.living, scene.is_away = "", True
    scene.time.run_for(10.0)
    assert scene.led == []
    scene.is_away = False
    scene.time.run_for(10.0)
    assert [name for name, _ in scene.led] == ["B"]


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
def test_nobody_leads_what_needs_no_leader(
    scene: Scene, change: Callable[[MissionContent], MissionContent | None]
) -> None:
    scene.content = change(RECORD)
    scene.begin("B")
    scene.time.run_for(1.0)
    scene.content = RECORD
    scene.time.run_for(100.0)
    assert scene.led == []


def test_they_give_up(scene: Scene) -> None:
    scene.is_away = True
    scene.begin("B")
    scene.time.run_for(DEFAULT_POLICY.succession_limit_s + 1.0)
    scene.is_away = False
    scene.time.run_for(10.0)
    assert scene.led == []
    scene.successions["B"].close()
    scene.begin("B")
    scene.time.run_for(10.0)
    assert scene.led == []
