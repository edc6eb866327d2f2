"""The building's missions as leaders store them: versions, bounds, and what mission control makes of them."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robocorba.errors.robots import IllegalOrder, InvalidProgram
from robocorba.errors.services import NotReachable, ServiceError
from robocorba.errors.simulation import InvalidMission, NoLeader, StaleMission, UnknownMission
from robocorba.missions.mission_control import GONE_LIMIT_S, HAND_OVER_S, LeaderWatch, MissionControl
from robocorba.simulation import mission_directory
from robocorba.simulation import store as store_module
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.mission_record import MemberRecord, MissionContent, MissionResult, PhaseRecord, decoded
from robocorba.simulation.store import MAX_DOCUMENT, Mission, SimulationStore
from tests.clock import Clock

ICON = json.dumps({"icon": "move_table", "table": "desk", "to": {"floor": "L1", "x": 1, "y": 2}})
RUNNING = MissionContent(
    kind="move_table",
    about="desk",
    leader="A",
    members=(MemberRecord("A", "leader"), MemberRecord("B", "helper")),
    phases=(PhaseRecord("asking", 100.0, 101.0), PhaseRecord("gathering", 101.0, 0.0, "B")),
    phases_in_all=7,
    begun=100.0,
)


def ended(at: float, **more: Any) -> MissionContent:
    return MissionContent(
        kind="move_table", about="desk", leader="A", begun=at - 10.0, ended=at, result=MissionResult.DONE, **more
    )


class Robots:
    """Robots as mission control calls them. refusing: those that refuse to lead. lead: the mission that each leads;
    absent ones don't answer."""

    def __init__(self, *refusing: str, **lead: str) -> None:
        self.refusing, self.lead = refusing, lead
        self.unable: list[str] = []
        self.aborted: list[str] = []
        self.called: list[str] = []

    def start(self, leader: str, mission: str, icon: str, term: int) -> None:
        if leader in self.unable:
            raise InvalidProgram("icons[0]", "", f"{leader} has no arms")
        if leader in self.refusing:
            raise IllegalOrder("run a program", "runs a program")
        self.mission_of(leader)
        self.lead[leader] = mission

    def abort(self, leader: str, mission: str) -> None:
        if self.mission_of(leader) != mission:
            raise UnknownMission(mission)
        self.aborted.append(mission)

    def mission_of(self, leader: str) -> str:
        self.called.append(leader)
        if leader not in self.lead:
            raise NotReachable(f"robot {leader} does not answer")
        return self.lead[leader]


@pytest.fixture
def store(tmp_path: Path) -> Any:
    with SimulationStore(tmp_path / "file") as store:
        yield store


@pytest.fixture
def missions(store: SimulationStore) -> MissionDirectory:
    return MissionDirectory(store, lambda: 1000.0)


def put(missions: MissionDirectory, name: str, content: MissionContent, version: int = 0) -> int:
    return missions.put_mission(Mission(name, version, content.encode()))


# ---- records ----


def test_changes_are_listed_since_a_version(missions: MissionDirectory) -> None:
    put(missions, "one", RUNNING)
    put(missions, "two", RUNNING)
    both = missions.since(0)
    assert [state.name for state in both] == ["one", "two"]
    assert missions.since(both[-1].version) == []
    put(missions, "one", ended(200.0), 1)
    (changed,) = missions.since(both[-1].version)
    assert (changed.name, changed.content.result) == ("one", MissionResult.DONE)
    assert [state.name for state in missions.since(0)] == ["two", "one"]
    assert missions.since(changed.version + 10**6) == missions.since(0), "a version of another server"


def test_a_mission_is_there_while_it_is_stored(missions: MissionDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    put(missions, "one", RUNNING)
    seen = []

    def look(document: bytes) -> MissionContent | None:
        seen.append(missions.mission("one").content)
        return decoded(document)

    monkeypatch.setattr(mission_directory, "decoded", look)
    put(missions, "one", ended(200.0), 1)
    assert seen == [RUNNING]
    assert missions.mission("one").content == ended(200.0)


def test_a_client_of_the_server_before_gets_all_missions(
    store: SimulationStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also on a computer without a real-time clock, which starts at the same time again. The order is that in which
    they were first stored, whatever their leaders' clocks said."""
    monkeypatch.setattr(time, "time_ns", lambda: 10**18)
    before = MissionDirectory(store)
    put(before, "first", ended(300.0, reason="a"))
    put(before, "but not by name", ended(200.0))
    version = before.since(0)[-1].version
    again = MissionDirectory(store)
    assert [state.name for state in again.since(version)] == ["first", "but not by name"]
    assert [mission.name for mission in again.missions()] == ["but not by name", "first"]
    assert again.mission("first").content == ended(300.0, reason="a")


def test_a_writer_that_is_late_is_refused(missions: MissionDirectory) -> None:
    assert [put(missions, "one", RUNNING), put(missions, "one", RUNNING, 1)] == [1, 2]
    for stale in (0, 1, 3):
        with pytest.raises(StaleMission) as refused:
            put(missions, "one", RUNNING, stale)
        assert refused.value.current == 2
    missions.remove_mission("one")
    for use in (missions.mission, missions.report, missions.remove_mission):
        with pytest.raises(UnknownMission):
            use("one")
    assert missions.since(0) == []


@pytest.mark.parametrize(
    "document",
    [
        *(b"", b"\xff\x00", b"[" * 100_000, b"[]", b'{"kind": "a"}'),
        RUNNING.encode().replace(b'"desk"', b'"de\\u0000sk"'),
        RUNNING.encode().replace(b"100.0", b"-1e999"),
        RUNNING.encode().replace(b'"term":1', b'"term":18446744073709551615'),
    ],
)
def test_other_documents_are_stored_and_not_listed(missions: MissionDirectory, document: bytes) -> None:
    assert missions.put_mission(Mission("other", 0, document)) == 1
    assert [mission.document for mission in missions.missions()] == [document]
    assert missions.since(0) == []


def test_a_mission_for_which_there_is_no_room_removes_no_others(
    store: SimulationStore, missions: MissionDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_module, "MAX_MISSIONS", 2)
    put(missions, "running", RUNNING)
    put(missions, "kept", ended(200.0))
    for mission in (("", 0, b""), ("x" * 201, 0, b""), ("new", 0, bytes(MAX_DOCUMENT + 1)), ("new", 3, b"")):
        with pytest.raises((InvalidMission, StaleMission)):
            missions.put_mission(Mission(*mission))
    assert {mission.name for mission in store.missions()} == {"running", "kept"}
    put(missions, "new", RUNNING)
    with pytest.raises(InvalidMission):
        put(missions, "newest", RUNNING)
    monkeypatch.setattr(store_module, "MAX_DOCUMENTS", 1000)
    with pytest.raises(InvalidMission):
        put(missions, "running", ended(300.0, report={"long": "x" * 1000}), 1)
    assert {mission.name for mission in store.missions()} == {"running", "new"}


@pytest.mark.parametrize("is_restarted", [False, True])
def test_the_missions_that_ended_first_make_room_whatever_clocks_said(
    store: SimulationStore, monkeypatch: pytest.MonkeyPatch, is_restarted: bool
) -> None:
    """Leaders a year ahead, and at the beginning of 1970; the server's own clock takes no part."""
    monkeypatch.setattr(store_module, "MAX_MISSIONS", 3)
    monkeypatch.setattr(time, "time", lambda: 4e9)
    missions = MissionDirectory(store)
    for name, at in (("first", 3e9), ("second", 20.0), ("third", 2e9)):
        put(missions, name, ended(at))
    if is_restarted:
        missions = MissionDirectory(store)
    LeaderWatch(missions, Robots(), lambda robot: False).check()
    put(missions, "fourth", RUNNING)
    assert [mission.name for mission in store.missions()] == ["second", "third", "fourth"]


@pytest.mark.parametrize("began", [20.0, 100.0, 3e9])
def test_a_mission_whose_leader_is_gone_ends_by_the_clock_of_that_leader(
    store: SimulationStore, monkeypatch: pytest.MonkeyPatch, began: float
) -> None:
    clock = Clock()
    missions = MissionDirectory(store, clock)
    phases = (PhaseRecord("asking", began, began + 1.0), PhaseRecord("gathering", began + 1.0, 0.0, "B"))
    put(missions, "one", msgspec.structs.replace(RUNNING, begun=began, phases=phases))
    clock.now += 30.0
    given = missions.give(missions.mission("one"), "B", "A was gone")
    assert given and given.content.leaders[-1].since == began + 31.0
    monkeypatch.setattr(time, "time", lambda: 4e9)  # ours is set
    clock.now += 9.0
    missions.fail(given, "its leader B was gone")
    content = missions.mission("one").content
    assert (content.ended, content.phases[-1].ended) == (began + 40.0, began + 40.0)
    assert json.loads(missions.report("one"))["seconds"] == 40.0


def test_a_report_is_the_leaders_or_what_the_record_says(missions: MissionDirectory) -> None:
    put(missions, "done", ended(200.0, report={"mission": "done", "result": "done"}))
    put(missions, "lost", RUNNING)
    assert json.loads(missions.report("done")) == {"mission": "done", "result": "done"}
    assert MissionContent.decode(ended(200.0, report={"long": "x" * MAX_DOCUMENT}).encode()).report is None
    missions.fail(missions.mission("lost"), "its leader was gone")
    report = json.loads(missions.report("lost"))
    assert (report["result"], report["reason"], report["seconds"]) == ("failed", "its leader was gone", 1.0)
    assert report["robots"] == {"A": "leader", "B": "helper"}
    assert [(phase["name"], phase["began_s"]) for phase in report["phases"]] == [("asking", 0.0), ("gathering", 1.0)]


def test_a_report_is_of_the_listed_document(
    store: SimulationStore, missions: MissionDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(missions, "one", RUNNING)
    read, writer = store.mission, threading.Thread(target=missions.put_mission, args=(Mission("one", 1, b"other"),))

    def read_late(name: str) -> Mission | None:
        if not writer.ident:
            writer.start()
            writer.join(0.5)  # it does not end while the report is being read
        return read(name)

    monkeypatch.setattr(store, "mission", read_late)
    assert json.loads(missions.report("one"))["result"] == "running"
    writer.join()
    with pytest.raises(UnknownMission):
        missions.report("one")


# ---- mission control ----


def test_a_mission_is_started_and_listed_at_once(missions: MissionDirectory) -> None:
    class Quick(Robots):
        """It stores a record before it answers."""

        def start(self, leader: str, mission: str, icon: str, term: int) -> None:
            put(missions, mission, RUNNING, missions.stored(mission).version)

    robots = Robots(A="")
    name = MissionControl(missions, robots).start("A", ICON)
    content = missions.mission(name).content
    assert robots.lead == {"A": name}
    assert (content.kind, content.about, content.leader) == ("move_table", "desk", "A")
    assert content.is_running
    assert missions.mission(MissionControl(missions, Quick()).start("A", ICON)).content == RUNNING


def test_a_refusal_leaves_no_record_and_robots_that_hang_do_not_occupy_the_server(missions: MissionDirectory) -> None:
    class Hanging(Robots):
        def start(self, leader: str, mission: str, icon: str, term: int) -> None:
            if leader != "C":
                control.start(chr(ord(leader) + 1), icon)

    robots = Robots()
    control = MissionControl(missions, robots)
    with pytest.raises(NoLeader, match="robot A does not answer"):
        control.start("A", ICON)
    robots.refusing = ("A",)
    with pytest.raises(IllegalOrder):
        control.start("A", ICON)
    assert missions.since(0) == []
    control = MissionControl(missions, Hanging())
    with pytest.raises(NoLeader, match="2 robots are being asked"):
        control.start("A", ICON)
    control.start("C", ICON)


def test_an_abort_hits_its_own_mission_only(missions: MissionDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocorba.missions.mission_control.ABORT_RETRY_S", 0.0)
    robots = Robots(A="second")
    control = MissionControl(missions, robots)
    put(missions, "first", RUNNING)
    put(missions, "second", RUNNING)
    put(missions, "done", ended(200.0))
    with pytest.raises(NoLeader, match="robot A does not lead mission 'first' any more"):
        control.abort("first")
    with pytest.raises(NoLeader, match="'done' has ended already, done"):
        control.abort("done")
    with pytest.raises(UnknownMission):
        control.abort("nothing")
    assert robots.aborted == []
    control.abort("second")
    assert robots.aborted == ["second"]
    monkeypatch.setattr("robocorba.missions.mission_control.ABORT_RETRY_S", 60.0)
    monkeypatch.setattr("robocorba.missions.mission_control.ABORT_PAUSE_S", 0.0)
    leads = iter(["", "", "first"])
    monkeypatch.setattr(robots, "mission_of", lambda leader: next(leads))
    control.abort("first")  # its leader has just accepted it
    assert robots.aborted == ["second", "first"]


@pytest.mark.parametrize(
    ("robots", "logged_on", "reason"),
    [
        (Robots(), False, "its leader A was gone for 60 s"),
        (Robots(A="other"), True, "its leader A did not lead it any more for 60 s"),
        (Robots(), True, "its leader A did not answer for 60 s"),
    ],
)
def test_a_mission_without_a_leader_fails(
    missions: MissionDirectory, robots: Robots, logged_on: bool, reason: str
) -> None:
    clock = Clock(0.0)
    watch = LeaderWatch(missions, robots, lambda robot: logged_on, clock)
    put(missions, "one", RUNNING)
    for clock.now in (0.0, GONE_LIMIT_S - 0.1):
        watch.check()
        assert missions.mission("one").content.is_running
    clock.now = GONE_LIMIT_S
    watch.check()
    content = missions.mission("one").content
    assert (content.result, content.reason, content.ended) == (MissionResult.FAILED, reason, 101.0)
    assert content.phases[-1].ended == 101.0
    put(missions, "one", ended(200.0), missions.missions()[0].version)
    assert missions.mission("one").content.result is MissionResult.DONE, "what a leader says that comes back"


def test_the_nearest_robot_that_can_leads(missions: MissionDirectory) -> None:
    robots = Robots("B", A="", B="", C="", D="")
    control = MissionControl(missions, robots, lambda about: ["B", "gone", "C", "D"] if about == "desk" else [])
    name = control.start("", '{"icon": "move_table", "table": "desk"}')
    assert name.startswith("desk-")
    assert robots.lead == {"A": "", "B": "", "C": name, "D": ""}
    assert missions.mission(name).content.leader == "C"
    with pytest.raises(NoLeader, match=r"no robot can lead it$"):
        control.start("", '{"icon": "move_table", "table": "sofa"}')
    robots.lead, robots.unable = {"C": "", "D": ""}, ["B", "gone", "C"]
    assert control.start("", '{"icon": "move_table", "table": "desk"}') == robots.lead["D"]
    robots.unable = ["B", "gone", "C", "D"]
    with pytest.raises(InvalidProgram, match="B has no arms"):
        control.start("", '{"icon": "move_table", "table": "desk"}')
    robots.lead, robots.unable = {}, []
    with pytest.raises(
        NoLeader, match=r"no robot can lead it; B: can't run a program: .*; gone: robot gone does not answer; C: "
    ):
        control.start("", '{"icon": "move_table", "table": "desk"}')


@pytest.mark.parametrize("of_b", ["", "one"])
def test_a_mission_whose_leader_is_gone_is_given_to_another_robot(missions: MissionDirectory, of_b: str) -> None:
    clock, robots = Clock(0.0), Robots("B", B=of_b, C="")
    watch = LeaderWatch(missions, robots, lambda robot: False, clock, lambda about: ["A", "B", "C"])
    put(missions, "one", msgspec.structs.replace(RUNNING, icon={"icon": "move_table"}))
    for clock.now in (0.0, HAND_OVER_S - 0.1):
        watch.check()
        assert missions.mission("one").content.leader == "A"
    clock.now = HAND_OVER_S
    watch.check()
    content = missions.mission("one").content
    assert robots.lead == {"B": of_b, "C": "one"}
    assert (content.leader, content.term) == ("C", 3)
    assert [each.reason for each in content.leaders] == ["", "A was gone", "A was gone"]
    clock.now = 10 * GONE_LIMIT_S
    watch.check()
    assert missions.mission("one").content.is_running


def test_each_leader_is_asked_once_a_check_until_the_watch_is_closed(missions: MissionDirectory) -> None:
    class Closing(Robots):
        def mission_of(self, leader: str) -> str:
            if "A" in self.called:
                watch.close()
            return super().mission_of(leader)

    for name, leader in (("one", "A"), ("two", "A"), ("three", "B"), ("four", "B"), ("five", "C")):
        put(missions, name, msgspec.structs.replace(RUNNING, leader=leader))
    robots, closing = Robots(A="two"), Closing(A="two")
    LeaderWatch(missions, robots, lambda robot: False).check()
    assert sorted(robots.called) == ["A", "B", "C"]
    watch = LeaderWatch(missions, closing, lambda robot: False)
    watch.check()
    assert closing.called == ["A", "B"]


def test_a_record_that_cannot_be_ended_stops_nothing(store: SimulationStore, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, missions, write = Clock(0.0), MissionDirectory(store), store.put_mission
    watch = LeaderWatch(missions, Robots(), lambda robot: False, clock)
    for name in ("full", "one"):
        put(missions, name, RUNNING)

    def put_mission(mission: Mission) -> int:
        if mission.name == "full":
            raise ServiceError("no space left")
        return write(mission)

    monkeypatch.setattr(store, "put_mission", put_mission)
    for _ in range(2):
        watch.check()
        clock.now += GONE_LIMIT_S
    assert [missions.mission(name).content.is_running for name in ("full", "one")] == [True, False]
    monkeypatch.undo()
    for _ in range(2):
        watch.check()
        clock.now += GONE_LIMIT_S
    assert not missions.mission("full").content.is_running


def test_a_robot_may_store_what_it_leads_or_takes_over(missions: MissionDirectory) -> None:
    members = tuple(MemberRecord(robot, "helper") for robot in "AB")
    before = msgspec.structs.replace(RUNNING, members=members)
    by_b = before.taken_over("B", "A was silent", 2.0)
    assert missions.may_put("A", "one", before.encode())
    assert not missions.may_put("B", "one", before.encode()), "in the name of another robot"
    assert not missions.may_put("A", "one", b"no mission")
    put(missions, "one", before)
    assert missions.may_put("A", "one", before.encode())
    assert missions.may_put("B", "one", by_b.encode())
    assert not missions.may_put("C", "one", before.taken_over("C", "A was silent", 2.0).encode()), "no member"
    skipping = by_b.taken_over("A", "B was silent", 3.0).taken_over("B", "A was silent", 4.0)
    assert not missions.may_put("B", "one", skipping.encode()), "not the next term"
    ended_before = before.ended_as(MissionResult.DONE, "", 5.0)
    put(missions, "two", ended_before)
    assert not missions.may_put("B", "two", by_b.encode()), "it has ended"
