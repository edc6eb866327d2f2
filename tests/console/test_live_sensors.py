"""Scans, postures and reservations for viewers: only what they want is read, and failures show."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robocorba.console import live_sensors
from robocorba.console.live_sensors import LiveSensors, Wanted
from robocorba.console.sensor_feed import NOTHING
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.sensing.fan import LASER
from robocorba.simulation.reservations import Reservation, ReservedAreas
from robocorba.simulation.robot_scans import RobotScan
from robocorba.spatial.posture import Posture
from tests.clock import Clock
from tests.console.test_sensor_feed import of_fan

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))


class Source:
    """An Omni database whose content a test sets."""

    def __init__(self) -> None:
        self.scans = [of_fan("A", LASER, 1.0)]
        self.angles = {"L1": [Posture("A", 1.0, (0.5,))], "L2": [Posture("B", 1.0, (0.7,))]}
        self.reserved = [ReservedAreas("A", (("L1", SQUARE),), Reservation(True, 0, 0.0, 9.96))]
        self.is_away = False
        self.calls: list[tuple[Any, ...]] = []

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


class Console:
    """Live sensors whose thread is the test."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.source, self.clock, self.news = Source(), Clock(), 0
        monkeypatch.setattr(live_sensors.time, "monotonic", self.clock)
        self.sensors = LiveSensors(self.source, lambda floor: 1.0, self.notify)

    def notify(self) -> None:
        self.news += 1

    def follow(self, seconds: float = 0.1) -> list[tuple[Any, ...]]:
        """The calls of a round that begins `seconds` later."""
        self.source.calls = []
        self.clock.now += seconds
        self.sensors.follow()
        return self.source.calls


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
    console.source.scans = [of_fan("A", LASER, 1.1), of_fan("B", LASER, 1.1)]
    console.follow()
    version, text = console.sensors.scans_message("L1", version)
    message = json.loads(text)["scans"]
    assert (message["whole"], [scan["key"] for scan in message["scans"]]) == (False, ["A/laser", "B/laser"])
    console.source.scans.pop(0)
    console.follow(live_sensors.WHOLE_S)
    version, text = console.sensors.scans_message("L1", version)
    assert json.loads(text)["scans"] == {"floor": "L1", "whole": False, "gone": ["A/laser"], "scans": []}


def test_postures_go_to_viewers_as_messages(console: Console) -> None:
    console.sensors.want("viewer", Wanted(postures=("L1", "L2")))
    console.follow()
    version, text = console.sensors.postures_message("L1", NOTHING)
    assert json.loads(text)["postures"] == {"floor": "L1", "whole": True, "gone": [], "robots": {"A": [0.5]}}
    console.source.angles = {"L1": [], "L2": [Posture("A", 2.0, (0.123456,)), Posture("B", 1.0, (0.7,))]}
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
    console.source.reserved = []
    console.follow(live_sensors.RESERVATIONS_S)
    _, text = console.sensors.reservations_message(version)
    assert json.loads(text) == {"reservations": []}


def test_viewers_are_woken_by_news_only(console: Console) -> None:
    console.sensors.want("viewer", Wanted(("L1",), ("L1",)))
    console.follow()
    assert console.news == 1
    console.follow()
    assert console.news == 1


def test_a_database_that_does_not_answer_shows_as_a_problem(console: Console) -> None:
    console.sensors.want("viewer", Wanted(("L1",)))
    console.follow()
    version, _ = console.sensors.scans_message("L1", NOTHING)
    console.source.is_away = True
    console.follow()
    assert (console.sensors.problem, console.news) == ("away", 2)
    assert console.sensors.scans_message("L1", version) == (version, "")  # what was seen stays
    console.source.is_away = False
    console.follow()
    assert (console.sensors.problem, console.news) == ("", 3)


def test_an_unknown_floor_is_empty(console: Console) -> None:
    console.sensors.want("viewer", Wanted(("roof",), ("roof",)))
    console.follow()
    for message in (console.sensors.scans_message, console.sensors.postures_message):
        (content,) = json.loads(message("roof", NOTHING)[1]).values()
        assert content["whole"]
    assert console.sensors.problem == ""


def test_names_of_any_kind_survive(console: Console) -> None:
    name = '"</script>\u202e'
    console.source.angles["L1"] = [Posture(name, 1.0, ())]
    console.sensors.want("viewer", Wanted(postures=("L1",)))
    console.follow()
    assert list(json.loads(console.sensors.postures_message("L1", NOTHING)[1])["postures"]["robots"]) == [name]
