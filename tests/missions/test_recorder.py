"""A leader's records of its missions, which never hold up the mission, and who leads it when its leader is gone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from msgspec.structs import replace

from robocorba.errors.robots import MissionFailed, MissionTakenOver
from robocorba.errors.services import NotPermitted, NotReachable
from robocorba.errors.simulation import InvalidMission, StaleMission, UnknownMission
from robocorba.missions import succession
from robocorba.missions.member import DEFAULT_POLICY
from robocorba.missions.recorder import MAX_WAITING, LedMission, MissionRecorder, claimed
from robocorba.missions.report import MissionReport
from robocorba.missions.subplan import CooperativePlan, Idle, PhaseSteps, plan_of
from robocorba.missions.succession import Succession
from robocorba.missions.transport import Received
from robocorba.simulation.mission_record import MemberRecord, MissionContent, MissionResult, PhaseRecord
from robocorba.simulation.store import Mission
from robocorba.system.backoff import Backoff
from tests.clock import Clock
from tests.missions.virtual_time import VirtualTime
from tests.robot.places import eventually

QUICK = Backoff(0.001, 0.002)
PLAN = plan_of(
    "m.1", "move_table", "A", "desk", (("A", "leader"), ("B", "helper")), [PhaseSteps("one", [Idle(), Idle()])] * 2
)
NEW = MissionContent(kind="move_table", about="desk", leader="A", begun=100.0)


class Database:
    """Missions by name, as the Omni database keeps them. is_away: it does not answer. is_guarded: it takes only those
    that A leads."""

    def __init__(self) -> None:
        self.missions: dict[str, tuple[int, MissionContent]] = {}
        self.is_away = self.is_guarded = False
        self.calls = 0
        self.gate = threading.Event()
        self.gate.set()

    def mission(self, name: str) -> Mission:
        if self.is_away:
            raise NotReachable("the Omni database does not answer")
        if name not in self.missions:
            raise UnknownMission(name)
        version, content = self.missions[name]
        return Mission(name, version, content.encode())

    def put_mission(self, mission: Mission) -> int:
        self.calls += 1
        self.gate.wait(60.0)
        if self.is_away:
            raise NotReachable("the Omni database does not answer")
        if self.is_guarded and self.missions.get(mission.name, (0, NEW))[1].leader != "A":
            raise NotPermitted("the Omni database")
        if mission.name == "invalid":
            raise InvalidMission("name", "1000 missions are stored already")
        current = self.missions[mission.name][0] if mission.name in self.missions else 0
        if mission.version != current:
            raise StaleMission(mission.name, mission.version, current)
        self.missions[mission.name] = current + 1, MissionContent.decode(mission.document)
        return current + 1

    def content(self, name: str) -> MissionContent | None:
        return self.missions[name][1] if name in self.missions else None


def content(begun: float, result: MissionResult = MissionResult.RUNNING) -> MissionContent:
    return replace(NEW, begun=begun, result=result)


@pytest.fixture
def database() -> Database:
    return Database()


@pytest.fixture
def recorder(database: Database) -> Iterator[MissionRecorder]:
    recorder = MissionRecorder(database, QUICK)
    yield recorder
    database.gate.set()
    recorder.close()


def has(database: Database, name: str, expected: MissionContent) -> None:
    eventually(lambda: database.content(name) == expected, f"{name} is recorded")


def test_a_recorder_does_not_wait_for_the_database_and_only_so_many_missions_wait(
    database: Database, recorder: MissionRecorder
) -> None:
    database.gate.clear()
    for number in range(2 * MAX_WAITING):
        recorder.record(f"m{number}", content(number))
    for begun in range(1, 100):
        recorder.record("last", content(begun))
    assert database.missions == {}
    database.gate.set()
    recorder.close()
    assert database.content("last") == content(99)
    assert len(database.missions) <= database.calls <= MAX_WAITING + 1


def test_a_database_that_was_away_gets_the_latest_state_but_for_what_it_refuses(
    database: Database, recorder: MissionRecorder
) -> None:
    recorder.record("invalid", content(1))
    recorder.record("m", content(1))
    has(database, "m", content(1))
    database.is_away = True
    recorder.record("m", content(2))
    before = database.calls
    eventually(lambda: database.calls > before + 3, "it is tried again")
    recorder.record("m", content(3, MissionResult.DONE))
    recorder.record("next", content(4))
    database.is_away = False
    has(database, "m", content(3, MissionResult.DONE))
    has(database, "next", content(4))
    database.is_away = True
    recorder.record("next", content(5))
    recorder.close()
    recorder.record("next", content(6))
    assert "mission records" not in {thread.name for thread in threading.enumerate()}


@pytest.mark.parametrize("is_guarded", [False, True])
def test_what_a_leader_of_a_later_term_has_written_stays(
    database: Database, recorder: MissionRecorder, is_guarded: bool
) -> None:
    database.is_guarded = is_guarded
    recorder.record("m", content(1))
    has(database, "m", content(1))
    later = content(1).taken_over("B", "A was silent", 2.0)
    database.missions["m"] = 7, later
    recorder.record("m", content(3, MissionResult.DONE))
    recorder.record("next", content(4))
    has(database, "next", content(4))
    assert database.content("m") == later
    with pytest.raises(MissionTakenOver, match=r"B has taken the mission over, in term 2"):
        recorder.write("m", content(3))
    del database.missions["m"]
    recorder.write("m", content(3))
    assert database.missions["m"] == (1, content(3))
    database.missions["m"] = 7, content(1, MissionResult.FAILED)  # mission control has written it
    recorder.write("m", content(4))
    assert database.missions["m"] == (8, content(4))
    database.missions["m"] = 9, replace(content(1), leader="B")
    with pytest.raises(MissionTakenOver, match="B has taken the mission over, in term 1"):
        recorder.write("m", content(5))


# ---- who leads ----

#: Led by another robot; by this one, before and after it began.
OTHERS, GIVEN = replace(NEW, leader="B", begun=1.0), replace(NEW, begun=4e9)
OWN = replace(GIVEN, phases=(PhaseRecord("asking", 4e9),))


@pytest.mark.parametrize(
    ("stored", "term", "claim"),
    [
        (None, 0, NEW),
        (GIVEN, 0, NEW),  # by the clock of its leader
        (OWN, 0, OWN),
        (replace(OWN, term=4), 4, replace(OWN, term=4)),
        (replace(NEW, term=2, is_offered=True), 2, replace(NEW, term=2)),
        (replace(OTHERS, attempts=3), 1, replace(OTHERS, attempts=3).taken_over("A", "B was silent", 100.0)),
        (OTHERS, 0, "B has taken the mission over, in term 1"),  # without a term nobody is displaced
        # A request waited in a socket while the mission was given to others, or to the same robot again.
        *((replace(given, term=given.term + 2), 2, "in term 3") for given in (OTHERS, NEW)),
        (replace(OTHERS, term=2, is_offered=True), 2, "in term 2"),
        (None, 1, "m is not offered any more"),
        (replace(NEW, result=MissionResult.FAILED), 0, "m has ended already: failed"),
    ],
)
def test_a_mission_is_claimed_unless_another_robot_leads_it(
    database: Database, stored: MissionContent | None, term: int, claim: MissionContent | str
) -> None:
    database.missions = {"m": (7, stored)} if stored else {}
    if isinstance(claim, str):
        with pytest.raises((MissionTakenOver, MissionFailed), match=claim):
            claimed(database, "m", NEW, term, lambda leader, mission: False)
        assert database.content("m") == stored
        return
    assert claimed(database, "m", NEW, term, lambda leader, mission: False) == claim
    assert database.content("m") == (claim if stored else None)


# ---- what is recorded ----


class Kept(MissionRecorder):
    """Keeps the latest state instead of writing it."""

    def __init__(self) -> None:
        super().__init__(Database())

    def record(self, name: str, content: MissionContent) -> None:
        self.latest = MissionContent.decode(content.encode())


def report(result: str, reason: str = "", received: list[Received] | None = None, plan: CooperativePlan | None = None):  # type: ignore[no-untyped-def]
    return MissionReport("m", "move table", "A", result, reason, 100.0, 120.0, plan, [], {}, received or [])


@pytest.fixture
def kept() -> Kept:
    return Kept()


def test_phases_say_who_is_waited_for_and_a_failure_ends_its_phase_and_the_mission_safely(kept: Kept) -> None:
    clock = Clock()
    led = LedMission(kept, "m", NEW, clock)
    assert kept.latest.phases == (PhaseRecord("asking", 100.0),)
    led.update(PLAN)
    assert kept.latest.members == (MemberRecord("A", "leader"), MemberRecord("B", "helper"))
    assert kept.latest.phases_in_all == 3
    assert kept.latest.plan
    phase = led.begin_phase(PLAN, "one", 102.0, ())
    assert kept.latest.phases == (PhaseRecord("asking", 100.0, 102.0), PhaseRecord("one", 102.0))
    phase.done["A"] = 103.0
    led.update(PLAN)
    assert kept.latest.phases[1] == PhaseRecord("one", 102.0, 0.0, "B")
    phase.done["B"] = 105.0
    led.update(PLAN)
    assert kept.latest.phases[1] == PhaseRecord("one", 102.0, 105.0, "B")
    led.begin_phase(PLAN, "two", 106.0, ()).done["A"] = 107.0
    clock.now = 110.0
    led.update(PLAN, True)
    assert kept.latest.phases[2:] == (PhaseRecord("two", 106.0, 110.0, "B"), PhaseRecord("ending safely", 110.0))
    led.end(report("failed", "two: B is silent", plan=PLAN)._replace(faults=("one: B is silent",)), False)
    assert (kept.latest.result, kept.latest.reason) == (MissionResult.FAILED, "two: B is silent")
    assert kept.latest.ended == kept.latest.phases[-1].ended == 120.0
    assert kept.latest.report is not None
    assert kept.latest.report["robots"] == {"A": "leader", "B": "helper"}
    assert (kept.latest.plan, kept.latest.faults) == (None, ("one: B is silent",))


def test_a_phase_that_was_ordered_for_later_has_not_lasted(kept: Kept) -> None:
    clock = Clock()
    led = LedMission(kept, "m", NEW, clock)
    clock.now = 101.9
    led.begin_phase(PLAN, "one", 102.0, ())
    led.update(PLAN, True)
    assert kept.latest.phases[1:] == (PhaseRecord("one", 101.9, 101.9), PhaseRecord("ending safely", 101.9))
    (*_, last) = kept.latest.ended_as(MissionResult.FAILED, "its leader is gone", 99.0).phases  # a clock is behind
    assert last == PhaseRecord("ending safely", 101.9, 101.9)


@pytest.mark.parametrize("behind_s", [0.0, 1.0, 3600.0, 365 * 86400.0])
def test_times_go_on_under_a_leader_whose_clock_is_behind(database: Database, kept: Kept, behind_s: float) -> None:
    began = 4e8
    former = (PhaseRecord("asking", began, began + 1.0), PhaseRecord("gathering", began + 1.0, 0.0, "B"))
    database.missions["m"] = 7, replace(content(began), leader="B", phases=former)
    clock = Clock(began + 1.0 - behind_s)
    taken = claimed(database, "m", replace(NEW, begun=clock.now), 1, lambda leader, mission: False)
    assert taken.leaders[-1].since == began + 1.0
    led = LedMission(kept, "m", taken, clock)
    led.begin_phase(PLAN, "one", clock.now + 2.0, ()).done.update(dict.fromkeys("AB", clock.now + 5.0))
    led.update(PLAN)
    clock.now += 9.0
    led.fail("B is silent")
    assert [(phase.begun - began, phase.ended - began) for phase in kept.latest.phases] == [
        *[(0.0, 1.0), (1.0, 1.0), (1.0, 3.0), (3.0, 6.0)]
    ]
    assert kept.latest.ended == began + 10.0


@pytest.mark.parametrize(
    ("end", "result"),
    [
        (lambda led: led.end(report("failed", "it was aborted"), True), MissionResult.ABORTED),
        (lambda led: led.end(report("done"), True), MissionResult.DONE),
        (lambda led: led.end(report("done"), False), MissionResult.DONE),
        (lambda led: led.fail("x" * 10_000), MissionResult.FAILED),
    ],
)
def test_ends(kept: Kept, end: Callable[[LedMission], None], result: MissionResult) -> None:
    end(LedMission(kept, "m", NEW, Clock()))
    assert kept.latest.result is result
    assert kept.latest.ended


RECORD = replace(NEW, icon={"icon": "move_table"}, members=tuple(MemberRecord(robot, "helper") for robot in "BAC"))


class Silence(Database):
    """Robots B and C, whose leader A is silent, and the database with their mission. busy: robots that can't lead.
    led: who has taken the mission over, and when [s]."""

    def __init__(self, time: VirtualTime, busy: str = "") -> None:
        super().__init__()
        self.time, self.missions = time, {"m": (1, RECORD)}
        self.led: list[tuple[str, float]] = []
        for name in "CB":
            lead, can_lead = partial(self._lead, name), partial(self._can_lead, name not in busy)
            Succession(name, self, lambda leader, mission: False, can_lead, lead).begin("m", 1)

    def _can_lead(self, is_free: bool, mission: str) -> bool:
        return is_free

    def _lead(self, name: str, mission: str, icon: dict[str, Any], term: int) -> None:
        self.led.append((name, self.time.now))
        self.missions[mission] = 2, RECORD.taken_over(name, "A was silent", 2.0)


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Iterator[VirtualTime]:
    time = VirtualTime()
    time.install(monkeypatch, succession)
    yield time
    time.close()


@pytest.mark.parametrize(("busy", "led"), [("", [("B", 0.0)]), ("B", [("C", DEFAULT_POLICY.turn_s)]), ("BC", [])])
def test_members_lead_in_turn(time: VirtualTime, busy: str, led: list[tuple[str, float]]) -> None:
    silence = Silence(time, busy)
    time.run_for(30.0)
    assert silence.led == led


@pytest.mark.parametrize(
    "record",
    [
        *(None, replace(RECORD, icon=None), replace(RECORD, members=())),
        *(RECORD.taken_over("C", "A was silent", 2.0), RECORD.ended_as(MissionResult.ABORTED, "it was aborted", 2.0)),
    ],
)
def test_nobody_leads_what_needs_no_leader(time: VirtualTime, record: MissionContent | None) -> None:
    silence = Silence(time)
    silence.missions = {"m": (1, record)} if record else {}
    time.run_for(1.0)
    silence.missions = {"m": (1, RECORD)}
    time.run_for(100.0)
    assert silence.led == []
