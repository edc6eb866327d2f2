"""What viewers get live: feeds of scans and postures, missions and reservations; only what they want is read."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from robocorba.console import live_missions, live_sensors
from robocorba.console.live_missions import LiveMissions, MissionFeed
from robocorba.console.live_sensors import LiveSensors, Wanted
from robocorba.console.sensor_feed import MAX_AGE_S, MAX_GONE, NOTHING, Feed, ScanFeed
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.sensing.fan import LASER, PROXIMITY, Fan
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState
from robocorba.simulation.reservations import Reservation, ReservedAreas
from robocorba.simulation.robot_scans import RobotScan
from robocorba.spatial.posture import Posture
from tests.clock import Clock
from tests.simulation.places import scan


def of_fan(robot: str, fan: Fan, time: float = 1.0, ahead: float = 0.0, **others: Any) -> RobotScan:
    """A scan of a sensor with these rays, all of which hit something at 0.5 m."""
    rays = {"first_rad": fan.first_rad, "step_rad": fan.step_rad, "range_m": fan.range_m}
    seen = {"distances": np.full(fan.count, 0.5), "hits": np.ones(fan.count, bool)}
    return scan(robot, time, ahead=ahead, **{**rays, **seen, **others})


def keys_after(*updates: tuple[list[RobotScan], bool, float, float]) -> list[str]:
    """The keys of a feed after these updates."""
    feed = ScanFeed()
    for update in updates:
        feed.update(*update)
    return list(feed.feed.keys)


def test_a_viewer_gets_everything_and_then_changes() -> None:
    feed = Feed()
    feed.put("A", 1)
    feed.put("B", [2])
    assert feed.since(NOTHING) == (True, {"A": "1", "B": "[2]"}, [])
    version = feed.version
    assert feed.since(version) == (False, {}, [])
    feed.put("A", 1)
    assert feed.version == version  # nothing new
    feed.put("A", 3)
    feed.drop(["B", "unknown"])
    assert feed.since(version) == (False, {"A": "3"}, ["B"])
    feed.put("B", 4)
    assert feed.since(version) == (False, {"A": "3", "B": "4"}, [])
    assert feed.since(NOTHING) == (True, {"A": "3", "B": "4"}, [])
    another = Feed()
    another.put("B", 2)
    assert another.since(version) == (True, {"B": "2"}, [])
    version = another.version
    for number in range(MAX_GONE + 5):
        another.put(str(number), number)
        another.drop([str(number)])
    assert another.since(version) == (True, {"B": "2"}, [])  # departed entries are forgotten at last


def test_scans_of_a_fan() -> None:
    feed = ScanFeed()
    hits = np.array([True, False, True])
    seen = of_fan("A", Fan(-0.1, 0.1, 3, 2.0), rim_m=0.4, distances=np.array([0.5, 2.0, 1.23456]), hits=hits)
    feed.update([seen], True, 1.0, 50.0)
    (text,) = feed.feed.since(NOTHING).entries.values()
    assert json.loads(text) == {
        **{"key": "A/sensor 1", "robot": "A", "sensor": "sensor 1", "time": 1.0},
        "pose": {"x": 1.0, "y": 2.0, "heading": 0.0},
        "mount": {"ahead": 0.0, "left": 0.0, "heading": 0.0},
        "angles": {"first": -0.1, "step": 0.1, "count": 3},
        **{"range": 2.0, "rim": 0.4, "ranges": [0.9, 2.4, pytest.approx(1.635)], "hits": [1, 0, 1]},
    }
    other = Fan(0.0, 0.1, 3, 2.0)
    found = [
        *(of_fan("A", LASER), of_fan("A", PROXIMITY), of_fan("A", LASER, ahead=0.2), of_fan("A", other)),
        *(of_fan("A", other, ahead=0.2), of_fan("B", LASER)),
    ]
    names, first = (
        ["A/laser", "A/proximity", "A/laser 2", "A/sensor 1", "A/sensor 2", "B/laser"],
        (found, True, 1.0, 50.0),
    )
    assert keys_after(first) == names
    assert keys_after(first, ([of_fan("A", LASER, 2.0, ahead=0.2)], False, 2.0, 51.0)) == names  # it keeps its name

    def seen(time: float, robot: str = "A") -> RobotScan:
        return of_fan(robot, LASER, time)

    both, b = ([seen(1.0), seen(1.0, "B")], True, 1.0, 50.0), [seen(1.1, "B")]
    assert keys_after(both, (b, False, 1.1, 50.1)) == ["A/laser", "B/laser"]
    assert keys_after(both, (b, False, 1.1, 50.1), (b, True, 1.1, 50.1)) == ["B/laser"]  # A has left
    first = ([seen(10.0)], True, 10.0, 50.0)
    ended = [([seen(10.0)], True, 10.0 + MAX_AGE_S + more, 50.0 + MAX_AGE_S + more) for more in (0.1, 0.2)]
    assert keys_after(first, *ended) == []
    assert keys_after(first, *ended, ([seen(13.0)], False, 13.0, 53.0)) == ["A/laser"]  # it comes back
    assert keys_after(first, ([], False, 10.1, 90.0)) == ["A/laser"]  # paused
    assert keys_after(first, ([seen(12.0)], False, 20.0, 50.1)) == ["A/laser"]  # simulated a hundred times as fast
    long_ago = ([seen(10.0), seen(99.0, "B")], True, 100.0, 50.0)
    assert keys_after(long_ago) == ["B/laser"]
    assert keys_after(long_ago, ([seen(100.1)], False, 100.1, 50.1)) == ["B/laser", "A/laser"]


SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))


class Console:
    """Live sensors whose thread is the test, of an Omni database whose content it sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.scans = [of_fan("A", LASER, 1.0)]
        self.angles = {"L1": [Posture("A", 1.0, (0.5,))], "L2": [Posture("B", 1.0, (0.7,))]}
        self.reserved = [ReservedAreas("A", (("L1", SQUARE),), Reservation(True, 0, 0.0, 9.96))]
        self.is_away, self.calls, self.notified = False, list[tuple[Any, ...]](), list[int]()
        self.clock = Clock()
        monkeypatch.setattr(live_sensors.time, "monotonic", self.clock)
        self.sensors = LiveSensors(self, lambda floor: 1.0, lambda: self.notified.append(1))

    @property
    def news(self) -> int:
        return len(self.notified)

    def follow(self, seconds: float = 0.1) -> list[tuple[Any, ...]]:
        """The calls of a round that begins `seconds` later."""
        self.calls = []
        self.clock.now += seconds
        self.sensors.follow()
        return self.calls

    def _count(self, *call: Any) -> None:
        self.calls.append(call)
        if self.is_away:
            raise NotReachable("away")
        if len(call) > 1 and call[1] not in self.angles:
            raise UnknownFloor("floorName", call[1], list(self.angles))

    def scans_since(self, floor: str, time_s: float) -> list[RobotScan]:
        self._count("scans", floor, time_s)
        return [scan for scan in self.scans if scan.time > time_s and scan.at.floor == floor]

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        self._count("postures", floor, time_s)
        return [posture for posture in self.angles[floor] if posture.time > time_s]

    def reservations(self) -> list[ReservedAreas]:
        self._count("reservations")
        return self.reserved


@pytest.fixture
def console(monkeypatch: pytest.MonkeyPatch) -> Console:
    return Console(monkeypatch)


def test_nothing_is_read_for_nobody(console: Console) -> None:
    assert console.follow() == []
    console.sensors.want("viewer", Wanted(("L1",), ("L2",)))
    assert console.follow() == [("scans", "L1", -1.0), ("postures", "L2", -1.0)]
    console.sensors.want("another", Wanted(("L1",)))
    console.sensors.want("viewer", Wanted())
    assert [call[:2] for call in console.follow()] == [("scans", "L1")]
    console.sensors.want("another", Wanted(reservations=True))
    assert console.follow() == [("reservations",)]
    console.sensors.want("another", Wanted())
    assert console.follow(10.0) == []
    assert console.sensors.scans_message("L1", NOTHING) == (NOTHING, "")


def test_only_what_is_new_is_asked_for_but_for_a_while_ago_and_now_and_then_all(console: Console) -> None:
    console.sensors.want("viewer", Wanted(("L1",), ("L1",)))
    console.follow()
    times = [pytest.approx(1.0 - live_sensors.OVERLAP_S)] * 2
    assert [call[2] for call in console.follow()] == times
    assert [call[2] for call in console.follow(live_sensors.WHOLE_S)] == [-1.0, -1.0]


def test_scans_go_to_viewers_as_messages(console: Console) -> None:
    console.sensors.want("viewer", Wanted(("L1",)))
    console.follow()
    version, text = console.sensors.scans_message("L1", NOTHING)
    message = json.loads(text)["scans"]
    assert (message["floor"], message["whole"], message["gone"]) == ("L1", True, [])
    assert [(scan["key"], scan["time"], len(scan["ranges"])) for scan in message["scans"]] == [("A/laser", 1.0, 181)]
    assert console.sensors.scans_message("L1", version) == (version, "")
    console.scans = [of_fan("A", LASER, 1.1), of_fan("B", LASER, 1.1)]
    console.follow()
    version, text = console.sensors.scans_message("L1", version)
    message = json.loads(text)["scans"]
    assert (message["whole"], [scan["key"] for scan in message["scans"]]) == (False, ["A/laser", "B/laser"])
    console.scans.pop(0)
    console.follow(live_sensors.WHOLE_S)
    version, text = console.sensors.scans_message("L1", version)
    assert json.loads(text)["scans"] == {"floor": "L1", "whole": False, "gone": ["A/laser"], "scans": []}


def test_postures_go_to_viewers_as_messages(console: Console) -> None:
    console.sensors.want("viewer", Wanted(postures=("L1", "L2")))
    console.follow()
    version, text = console.sensors.postures_message("L1", NOTHING)
    assert json.loads(text)["postures"] == {"floor": "L1", "whole": True, "gone": [], "robots": {"A": [0.5]}}
    console.angles = {"L1": [], "L2": [Posture("A", 2.0, (0.123456,)), Posture("B", 1.0, (0.7,))]}
    console.follow(live_sensors.WHOLE_S)
    version, text = console.sensors.postures_message("L1", version)
    assert json.loads(text)["postures"] == {"floor": "L1", "whole": False, "gone": ["A"], "robots": {}}
    _, text = console.sensors.postures_message("L2", NOTHING)
    assert json.loads(text)["postures"]["robots"] == {"B": [0.7], "A": [0.1235]}


def test_reservations_go_to_viewers_as_messages(console: Console) -> None:
    assert console.sensors.reservations_message(NOTHING) == (NOTHING, "")
    console.sensors.want("viewer", Wanted(reservations=True))
    console.follow()
    version, text = console.sensors.reservations_message(NOTHING)
    areas = [{"floor": "L1", "polygon": [list(corner) for corner in SQUARE]}]
    expected = {"robot": "A", "phase": "granted", "ahead": 0, "left": 10.0, "areas": areas}
    assert json.loads(text) == {"reservations": [expected]}
    assert console.follow() == []  # seldom
    console.reserved = []
    console.follow(live_sensors.RESERVATIONS_S)
    _, text = console.sensors.reservations_message(version)
    assert json.loads(text) == {"reservations": []}


def test_viewers_are_woken_by_news_and_problems_only(console: Console) -> None:
    console.sensors.want("viewer", Wanted(("L1",), ("L1",)))
    for _ in range(2):
        console.follow()
        assert console.news == 1
    version, _ = console.sensors.scans_message("L1", NOTHING)
    console.is_away = True
    console.follow()
    assert (console.sensors.problem, console.news) == ("away", 2)
    assert console.sensors.scans_message("L1", version) == (version, "")  # what was seen stays
    console.is_away = False
    console.follow()
    assert (console.sensors.problem, console.news) == ("", 3)


def test_an_unknown_floor_is_empty_and_names_of_any_kind_survive(console: Console) -> None:
    name = '"</script>\u202e'
    console.angles["L1"] = [Posture(name, 1.0, ())]
    console.sensors.want("viewer", Wanted(("roof",), ("roof", "L1")))
    console.follow()
    for message in (console.sensors.scans_message, console.sensors.postures_message):
        (content,) = json.loads(message("roof", NOTHING)[1]).values()
        assert content["whole"]
    assert console.sensors.problem == ""
    assert list(json.loads(console.sensors.postures_message("L1", NOTHING)[1])["postures"]["robots"]) == [name]


def mission(name: str, version: int, result: MissionResult = MissionResult.RUNNING) -> MissionState:
    content = MissionContent(kind="move_table", about="desk", leader="A", begun=1.0, result=result)
    return MissionState(name, version, content)


class MissionsPlace:
    """Live missions of a mission control. asked: the versions in the requests to it."""

    def __init__(self) -> None:
        self.states: dict[str, MissionState] = {}
        self.asked, self.is_away, self.woken = list[int](), False, list[int]()
        self.missions = LiveMissions(self, lambda: self.woken.append(1))

    def missions_since(self, version: int) -> list[MissionState]:
        self.asked.append(version)
        if self.is_away:
            raise NotReachable("mission control does not answer")
        return [each for each in self.states.values() if each.version > version]

    def feed(self) -> MissionFeed:
        feed = MissionFeed(self.missions)
        feed.want(True)
        return feed

    def follow(self, *missions: MissionState) -> None:
        """Follow mission control once it has these."""
        self.states.update((each.name, each) for each in missions)
        self.missions.follow()


@pytest.fixture
def place() -> MissionsPlace:
    return MissionsPlace()


def news(feed: MissionFeed) -> tuple[bool, list[str]] | None:
    """Whether a message is whole, and the names in it; None for no message."""
    message = feed.message()
    if not message:
        return None
    found: dict[str, Any] = json.loads(message)
    return found["whole"], [row["name"] for row in found["missions"]]


def test_nobody_is_asked_for_nobody_and_a_building_without_missions_is_known_as_such(place: MissionsPlace) -> None:
    place.follow()
    assert place.asked == []
    feed = place.feed()
    place.follow()
    assert news(feed) == (True, [])
    place.follow()
    assert news(feed) is None
    feed.want(False)
    place.follow()
    assert len(place.asked) == 2


def test_a_viewer_gets_all_and_then_what_has_changed(place: MissionsPlace) -> None:
    early, late = place.feed(), MissionFeed(place.missions)
    assert news(early) is None, "nothing is known yet"
    place.follow(mission("one", 5), mission("two", 6))
    assert news(early) == (True, ["one", "two"])
    assert news(early) is None
    place.follow(mission("one", 7, MissionResult.DONE))
    assert news(early) == (False, ["one"])
    late.want(True)
    assert news(late) == (True, ["two", "one"])
    assert place.asked == [0, 6]
    assert len(place.woken) == 2


def test_removed_missions_disappear(place: MissionsPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_missions, "ALL_INTERVAL_S", 0.0)
    feed = place.feed()
    place.follow(mission("one", 5), mission("<b>مهمة\u202e", 6))
    _, row = json.loads(feed.message())["missions"]
    assert row == {
        **{"name": "<b>مهمة\u202e", "kind": "move_table", "about": "desk", "leader": "A", "term": 1, "members": []},
        **{"phases": [], "phases_in_all": 0, "begun": 1.0, "ended": 0.0, "result": "running", "reason": ""},
    }
    del place.states["one"]
    place.follow()
    assert news(feed) == (True, ["<b>مهمة\u202e"])


def test_a_server_that_was_away_is_asked_for_everything(place: MissionsPlace) -> None:
    feed = place.feed()
    place.follow(mission("one", 5))
    news(feed)
    place.is_away = True
    for _ in range(2):
        place.follow()
    assert place.missions.problem == "mission control does not answer"
    assert len(place.woken) == 2, "once for the missions, once for the problem"
    place.is_away = False
    place.follow(mission("one", 100), mission("new", 101))
    assert place.missions.problem == ""
    assert news(feed) == (False, ["new"]), "the other one is as it was"
    assert place.asked[-1] == 0
