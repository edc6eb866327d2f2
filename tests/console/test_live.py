"""What viewers get live of floors, sensors, missions and robots; only what they want is read."""

from __future__ import annotations

import asyncio
import contextlib
import json
import struct
from collections.abc import Callable, Collection, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocorba.console import live_missions, live_sensors, system_state
from robocorba.console.corba.system_state import agent_is_driving, path_by_floor
from robocorba.console.defects import DEFECT
from robocorba.console.live_missions import LiveMissions
from robocorba.console.live_sensors import LiveSensors, Topic
from robocorba.console.robot_views import RETRY_S, SLOW_INTERVAL_S, RobotView, RobotViews
from robocorba.console.sensor_feed import MAX_AGE_S, MAX_GONE, MAX_RAYS, NOTHING, Feed, ScanFeed
from robocorba.console.system_state import SystemState
from robocorba.console.viewers import TRY_AGAIN_LATER, Viewers
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, FloorUpdate
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState
from robocorba.simulation.reservations import Reservation, ReservedAreas
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import LASER, PROXIMITY
from robocorba.system.names import ROBOTS
from testkit.processes import eventually
from tests.clock import Clock
from tests.simulation.places import scan
from tests.waits import until


def of_fan(robot: str, fan: Fan, time: float = 1.0, ahead: float = 0.0, **others: Any) -> RobotScan:
    """A scan of a sensor with these rays, all of which hit something at 0.5 m."""
    rays = {"first_rad": fan.first_rad, "step_rad": fan.step_rad, "range_m": fan.range_m}
    seen = {"distances": np.full(fan.count, 0.5), "hits": np.ones(fan.count, bool)}
    return scan(robot, time, ahead=ahead, **{**rays, **seen, **others})


def keys_after(*updates: tuple[list[RobotScan], bool, float, float]) -> list[str]:
    """The keys of a feed after these updates."""
    feed = ScanFeed()
    for update in updates:
        feed.receive(*update)
    return list(feed.since(NOTHING).entries)


def test_a_feed_has_all_and_then_changes_and_forgets_what_has_gone_long_ago() -> None:
    feed = Feed()
    feed.put("A", 1)
    feed.put("B", [2])
    version = feed.version
    assert feed.since(version) == (False, {}, [])
    feed.put("A", 1)
    assert feed.version == version  # nothing new
    feed.put("A", 3)
    feed.drop(["B", "unknown"])
    assert feed.since(version) == (False, {"A": "3"}, ["B"])
    feed.put("B", 4)
    assert feed.since(version) == (False, {"A": "3", "B": "4"}, [])
    another = Feed()
    another.put("B", 2)
    assert another.since(version) == (True, {"B": "2"}, [])
    version = another.version
    for number in range(MAX_GONE + 5):
        another.put(str(number), number)
        another.drop([str(number)])
    assert another.since(version) == (True, {"B": "2"}, [])


def test_scans_of_a_fan() -> None:
    feed = ScanFeed()

    def shown(seen: RobotScan, is_whole: bool = False) -> dict[str, Any]:
        feed.receive([seen], is_whole, 1.1, 50.1)
        found: dict[str, Any] = json.loads(feed.since(NOTHING).entries[f"{seen.robot}/sensor 1"])
        return found

    hits = np.array([True, False, True])
    seen = of_fan("A", Fan(-0.1, 0.1, 3, 2.0), rim_m=0.4, distances=np.array([0.5, 2.0, 1.23456]), hits=hits)
    assert shown(seen, is_whole=True) == {
        **{"key": "A/sensor 1", "robot": "A", "sensor": "sensor 1", "time": 1.0},
        "pose": {"x": 1.0, "y": 2.0, "heading": 0.0},
        "mount": {"ahead": 0.0, "left": 0.0, "heading": 0.0},
        "angles": {"first": -0.1, "step": 0.1, "count": 3},
        **{"range": 2.0, "rim": 0.4, "ranges": [0.9, 2.4, pytest.approx(1.635)], "hits": [1, 0, 1], "virtual": True},
    }
    own = seen._replace(time=1.1, is_virtual=False, unmapped=np.array([False, False, True]))
    assert shown(own).items() >= {"hits": [1, 0, 2], "virtual": False}.items()
    assert shown(own._replace(distances=own.distances / 2))["ranges"][0] == 0.65  # simulated time is paused
    many = Fan(0.0, 0.001, 2 * MAX_RAYS + 1, 2.0)
    thin = shown(of_fan("B", many, distances=np.linspace(0.0, 1.0, many.count)))
    assert thin["angles"] == {"first": 0.0, "step": pytest.approx(0.003), "count": 481} and len(thin["hits"]) == 481
    assert thin["ranges"][-1] == pytest.approx(1.0, abs=0.001)


def test_scans_keep_their_names_until_they_end() -> None:
    def seen(time: float, robot: str = "A") -> RobotScan:
        return of_fan(robot, LASER, time)

    other = Fan(0.0, 0.1, 3, 2.0)
    found = [of_fan("A", fan, ahead=ahead) for ahead in (0.0, 0.2) for fan in (LASER, other)]
    first = [of_fan("B", LASER), of_fan("A", PROXIMITY), *found], True, 1.0, 50.0
    names = ["B/laser", "A/proximity", "A/laser", "A/sensor 1", "A/laser 2", "A/sensor 2"]
    assert keys_after(first) == names
    assert keys_after(first, ([of_fan("A", LASER, 2.0, ahead=0.2)], False, 2.0, 51.0)) == names
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
AREAS: Topic = ("reservations", "")


def scans_of(*floors: str) -> list[Topic]:
    return [("scans", floor) for floor in floors]


def postures_of(*floors: str) -> list[Topic]:
    return [("postures", floor) for floor in floors]


class Console:
    """Live sensors whose thread is the test, of an Omni database whose content it sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.scans = [of_fan("A", LASER, 1.0)]
        self.angles = {"L1": [Posture("A", 1.0, (0.5,))], "L2": [Posture("B", 1.0, (0.7,))]}
        self.reserved = [ReservedAreas("A", (("L1", SQUARE),), Reservation(True, 0, 0.0, 9.96))]
        self.is_away, self.calls, self.notified = False, list[tuple[Any, ...]](), list[int]()
        self.asked, self.sensed = list[tuple[list[str], list[str]]](), list[RobotScan]()
        self.clock, self._versions = Clock(), dict[Topic, int]()
        monkeypatch.setattr(live_sensors.time, "monotonic", self.clock)
        self.sensors = LiveSensors(self, lambda floor: 1.0, self.ask_robots, lambda: self.notified.append(1))

    @property
    def news(self) -> int:
        return len(self.notified)

    def follow(self, seconds: float = 0.1) -> list[tuple[Any, ...]]:
        """The calls of a round that begins `seconds` later."""
        self.calls = []
        self.clock.now += seconds
        self.sensors.follow()
        return self.calls

    def message(self, *topic: str) -> Any:
        """To a page that has had those before; None without news."""
        kind, floor = topic
        version, text = self.sensors.message((kind, floor), self._versions.get((kind, floor), NOTHING))
        self._versions[kind, floor] = version
        return json.loads(text)[kind] if text else None

    def _count(self, *call: Any) -> None:
        self.calls.append(call)
        if self.is_away:
            raise NotReachable("away")
        if len(call) > 1 and call[1] not in self.angles:
            raise UnknownFloor("floorName", call[1], list(self.angles))

    def scans_since(self, floor: str, time_s: float) -> list[RobotScan]:
        self._count("scans", floor, time_s)
        return [scan for scan in self.scans if scan.time > time_s and scan.at.floor == floor]

    def ask_robots(self, floors: Collection[str], first: Collection[str]) -> list[RobotScan]:
        self.asked.append((list(floors), sorted(first)))
        return self.sensed

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
    console.sensors.want("viewer", [*scans_of("L1"), *postures_of("L2")], ["A"])
    assert console.follow() == [("scans", "L1", -1.0), ("postures", "L2", -1.0)]
    console.sensors.want("another", scans_of("L1"), ["B"])
    console.sensors.want("viewer", ())
    assert [call[:2] for call in console.follow()] == [("scans", "L1")]
    console.sensors.want("another", [AREAS])
    assert console.follow() == [("reservations",)]
    console.sensors.want("another", ())
    assert console.follow(10.0) == []
    assert console.asked == [(["L1"], ["A"]), (["L1"], ["B"])]
    assert console.message("scans", "L1") is None


def test_only_what_is_new_is_asked_for_but_for_a_while_ago_and_now_and_then_all(console: Console) -> None:
    console.sensors.want("viewer", [*scans_of("L1"), *postures_of("L1")])
    console.follow()
    times = [pytest.approx(1.0 - live_sensors.OVERLAP_S)] * 2
    assert [call[2] for call in console.follow()] == times
    assert [call[2] for call in console.follow(live_sensors.WHOLE_S)] == [-1.0, -1.0]


def test_scans_and_postures_go_to_viewers_as_messages(console: Console) -> None:
    name = '"</script>\u202e'
    console.sensors.want("viewer", [*scans_of("L1", "roof"), *postures_of("L1", "L2", "roof")])
    console.follow()
    message = console.message("scans", "L1")
    assert (message["floor"], message["whole"], message["gone"]) == ("L1", True, [])
    assert [(scan["key"], scan["time"], len(scan["ranges"])) for scan in message["scans"]] == [("A/laser", 1.0, 181)]
    assert console.message("scans", "L1") is None
    assert console.message("postures", "L1") == {"floor": "L1", "whole": True, "gone": [], "robots": {"A": [0.5]}}
    assert console.message("scans", "roof")["whole"] and console.message("postures", "roof")["whole"]
    assert console.sensors.problem == "", "a floor that is not there is empty"
    console.scans = [of_fan("A", LASER, 1.1), of_fan("B", LASER, 1.1)]
    console.follow()
    message = console.message("scans", "L1")
    assert (message["whole"], [scan["key"] for scan in message["scans"]]) == (False, ["A/laser", "B/laser"])
    console.scans.pop(0)
    console.angles = {"L1": [], "L2": [Posture("A", 2.0, (0.123456,)), Posture(name, 1.0, (0.7,))]}
    console.follow(live_sensors.WHOLE_S)
    assert console.message("scans", "L1") == {"floor": "L1", "whole": False, "gone": ["A/laser"], "scans": []}
    assert console.message("postures", "L1") == {"floor": "L1", "whole": False, "gone": ["A"], "robots": {}}
    assert console.message("postures", "L2")["robots"] == {name: [0.7], "A": [0.1235]}
    del console.angles["L2"]
    console.follow()
    assert sorted(console.message("postures", "L2")["gone"]) == [name, "A"]


def test_what_sensors_see_now_goes_before_what_programs_saw(console: Console) -> None:
    """A sensor of both has one scan, the last one; the programs' other sensors are shown beside."""

    def times() -> dict[str, float]:
        _, text = console.sensors.message(("scans", "L1"), NOTHING)
        return {scan["key"]: scan["time"] for scan in json.loads(text)["scans"]["scans"]}

    console.scans = [of_fan("A", LASER, 1.0), of_fan("A", LASER, 1.0, ahead=0.2)]
    console.sensed = [of_fan("A", LASER, 1.05), of_fan("A", PROXIMITY, 1.05), of_fan("B", LASER, 1.05, floor="L2")]
    console.sensors.want("viewer", scans_of("L1"))
    for seconds in (0.1, live_sensors.WHOLE_S, 0.1):
        console.follow(seconds)
        assert times() == {"A/laser": 1.05, "A/laser 2": 1.0, "A/proximity": 1.05}
    console.sensed = []
    console.follow(live_sensors.WHOLE_S)
    assert times().keys() == {"A/laser", "A/laser 2"}


def test_reservations_go_to_viewers_as_messages(console: Console) -> None:
    assert console.message(*AREAS) is None
    console.sensors.want("viewer", [AREAS])
    console.follow()
    areas = [{"floor": "L1", "polygon": [list(corner) for corner in SQUARE]}]
    expected = {"robot": "A", "phase": "granted", "ahead": 0, "left": 10.0, "areas": areas}
    assert console.message(*AREAS) == [expected]
    assert console.follow() == []  # seldom
    console.reserved = []
    console.follow(live_sensors.RESERVATIONS_S)
    assert console.message(*AREAS) == []


def test_viewers_are_woken_by_news_and_problems_only(console: Console) -> None:
    console.sensors.want("viewer", [*scans_of("L1"), *postures_of("L1")])
    for _ in range(2):
        console.follow()
        assert console.news == 1
    assert console.message("scans", "L1")
    for is_away, problem, news in ((True, "away", 2), (False, "", 3)):
        console.is_away = is_away
        console.follow()
        assert (console.sensors.problem, console.news) == (problem, news)
        assert console.message("scans", "L1") is None  # what was seen stays


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

    def follow(self, *missions: MissionState) -> None:
        """Follow mission control once it has these."""
        self.states.update((each.name, each) for each in missions)
        self.missions.follow()


@pytest.fixture
def place() -> MissionsPlace:
    return MissionsPlace()


class MissionsPage:
    """A page that wants missions."""

    def __init__(self, place: MissionsPlace) -> None:
        self._missions, self._version = place.missions, NOTHING
        place.missions.want(self, True)

    def message(self) -> dict[str, Any]:
        self._version, text = self._missions.message(self._version)
        return json.loads(text) if text else {}

    def news(self) -> tuple[bool, list[str], list[str]] | None:
        """Whether a message is whole, the names in it, and those of missions that are gone; None for no message."""
        found = self.message()
        return (found["whole"], [row["name"] for row in found["missions"]], found["gone"]) if found else None


def test_nobody_is_asked_for_nobody_and_a_building_without_missions_is_known_as_such(place: MissionsPlace) -> None:
    place.follow()
    assert place.asked == []
    page = MissionsPage(place)
    for news in ((True, [], []), None):
        place.follow()
        assert page.news() == news
    place.missions.want(page, False)
    place.follow()
    assert len(place.asked) == 2


def test_a_viewer_gets_all_and_then_what_has_changed(place: MissionsPlace, monkeypatch: pytest.MonkeyPatch) -> None:
    early, two, clock = MissionsPage(place), "<b>مهمة\u202e", Clock()
    monkeypatch.setattr(live_missions.time, "monotonic", clock)
    assert early.news() is None, "nothing is known yet"
    place.follow(mission("one", 5), mission(two, 6))
    assert early.news() == (True, ["one", two], [])
    assert early.news() is None
    place.follow(mission("one", 7, MissionResult.DONE))
    assert early.news() == (False, ["one"], [])
    _, row = MissionsPage(place).message()["missions"]
    assert row == {
        **{"name": two, "kind": "move_table", "about": "desk", "leader": "A", "term": 1, "members": []},
        **{"phases": [], "phases_in_all": 0, "begun": 1.0, "ended": 0.0, "result": "running", "reason": ""},
    }
    assert place.asked == [0, 6]
    assert len(place.woken) == 2
    clock.now += live_missions.ALL_INTERVAL_S
    del place.states["one"]
    place.follow()
    assert early.news() == (False, [], ["one"])


def test_a_server_that_was_away_is_asked_for_everything(place: MissionsPlace) -> None:
    page = MissionsPage(place)
    place.follow(mission("one", 5))
    page.news()
    place.is_away = True
    for _ in range(2):
        place.follow()
    assert place.missions.problem == "mission control does not answer"
    assert len(place.woken) == 2, "once for the missions, once for the problem"
    place.is_away = False
    place.follow(mission("one", 100), mission("new", 101))
    assert place.missions.problem == ""
    assert page.news() == (False, ["new"], []), "the other one is as it was"
    assert place.asked[-1] == 0


class Wants:
    """Floors, their map, and sensors with news on each floor, once; what viewers want of them."""

    names: tuple[str, ...] = ()
    problem, version = "", 1

    def __init__(self) -> None:
        self.watched, self.wanted, self.wants_missions = list[list[str]](), list[Any](), list[bool]()
        self.first = list[list[str]]()
        self.missions = SimpleNamespace(
            problem="",
            want=lambda viewer, is_wanted: self.wants_missions.append(is_wanted),
            message=lambda version: self.message(("missions", ""), version),
        )

    def watch(self, viewer: object, floors: Any) -> None:
        self.watched.append(list(floors))

    def floor(self, name: str) -> Wants:
        return self

    def frame_since(self, version: int) -> tuple[int, bytes]:
        return 1, b"" if version else b"frame"

    def want(self, viewer: object, wanted: Any, first: Any = ()) -> None:
        self.wanted.append(wanted)
        self.first.append(list(first))

    def message(self, topic: Topic, version: int) -> tuple[int, str]:
        kind, floor = topic
        return 7, json.dumps({kind: floor or []}) if version == NOTHING else ""


class Socket:
    """A browser that sends what a test gives it; it leaves when `is_done` of what it got."""

    def __init__(self, messages: list[str], is_done: Callable[[list[Any]], bool] = lambda got: False) -> None:
        self._messages, self._is_done = messages, is_done
        self.got, self.closed, self.done = list[Any](), (0, ""), asyncio.Event()

    async def accept(self) -> None: ...

    async def close(self, code: int = 1000, reason: str = "") -> None:
        self.closed = code, reason

    async def receive_text(self) -> str:
        if self._messages:
            return self._messages.pop(0)
        await self.done.wait()
        raise RuntimeError("left")

    async def send_text(self, text: str) -> None:
        await self.send_bytes(json.loads(text))

    async def send_bytes(self, message: Any) -> None:
        self.got.append(message)
        if self._is_done(self.got):
            self.done.set()


def serve(*messages: str, is_done: Callable[[list[Any]], bool]) -> tuple[list[Any], Wants]:
    """What the browser gets until it leaves, and what was wanted for it."""
    wants = Wants()

    async def run() -> list[Any]:
        viewers, socket = viewers_of(wants), Socket(list(messages), is_done)
        await asyncio.wait_for(viewers.serve(socket), 20.0)
        assert viewers.count == 0
        return list(socket.got)

    return asyncio.run(run()), wants


def viewers_of(wants: Any, **more: Any) -> Any:
    viewers: Any = Viewers(SimpleNamespace(rows=dict), **more)
    viewers.attach(wants, wants, wants, wants.missions)
    return viewers


def test_a_viewer_gets_what_it_wants_unless_it_sends_nonsense() -> None:
    wanted = {"watch": ["L1"], "scans": ["L1", "L2"], "postures": ["L2"], "reservations": True, "missions": True}
    wanted["robots"] = ["A"]
    got, wants = serve(json.dumps(wanted), is_done=lambda got: {"missions": []} in got)
    texts = [{"scans": "L1"}, {"scans": "L2"}, {"postures": "L2"}, {"reservations": []}, {"missions": []}]
    for message in (b"frame", *texts):
        assert got.count(message) == 1
    assert wants.wants_missions == [True, False]
    assert wants.wanted == [[*scans_of("L1", "L2"), *postures_of("L2"), AREAS], ()]
    assert (wants.watched, wants.first) == ([["L1"], []], [["A"], []])
    for others in (
        {},
        {"scans": False},
        {"scans": None, "robots": 3, "postures": "L1", "reservations": 1, "missions": 1},
    ):
        got, wants = serve(json.dumps({"watch": ["L1"], **others}), is_done=lambda got: b"frame" in got)
        assert b"frame" in got
        assert not wants.wanted[0] and not wants.wants_missions[0] and not wants.first[0]
    for nonsense in ("no json", "[]", "5", "{}", "null", "[" * 3000, "x" * 5000):
        assert serve(nonsense, is_done=lambda got: False)[1].wanted == [()]


def test_a_viewer_too_many_is_refused_until_another_one_leaves() -> None:
    async def run() -> None:
        viewers = viewers_of(Wants(), limit=2)
        sockets = [Socket([]) for _ in range(4)]
        tasks = [asyncio.create_task(viewers.serve(socket)) for socket in sockets[:2]]
        await until(lambda: viewers.count == 2)
        await asyncio.wait_for(viewers.serve(sockets[2]), 20.0)
        code, reason = sockets[2].closed
        assert code == TRY_AGAIN_LATER
        assert "serves 2 pages at a time" in reason and len(reason.encode()) <= 123 - 10
        assert (sockets[2].got, viewers.count) == ([], 2)
        sockets[0].done.set()
        await asyncio.wait_for(tasks[0], 20.0)
        tasks.append(asyncio.create_task(viewers.serve(sockets[3])))
        await until(lambda: sockets[3].got)
        for socket in sockets:
            socket.done.set()
        await asyncio.wait_for(asyncio.gather(*tasks), 20.0)

    asyncio.run(run())


POINT = {"floor": "L1", "x": 1.0, "y": 2.0, "heading": 0.0}


class FakeRobot:
    def __init__(self) -> None:
        self.floor, self.version, self.way = "L1", 5, [POINT]
        self.lag_s, self.angles = 0.02, [Posture("A", 3.0, (0.1,))]
        self.asked, self.hangs = list[int](), False

    def path(self) -> list[dict[str, Any]]:
        if self.hangs:
            raise NotReachable("A does not answer")
        return list(self.way)

    def changes(self, since: int) -> FloorUpdate:
        self.path()
        self.asked.append(since)
        start = since if since == self.version else WHOLE
        return FloorUpdate(self.floor, start, self.version, 1.0, 1, [], [], np.empty(0, MOTION), {})

    def postures(self, time_s: float) -> list[Posture]:
        return [posture for posture in self.angles if posture.time > time_s]


def jsons(messages: list[Any]) -> dict[str, Any]:
    return {key: value for message in messages if isinstance(message, dict) for key, value in message.items()}


def frames(messages: list[Any]) -> list[dict[str, Any]]:
    found = [message for message in messages if isinstance(message, bytes)]
    return [json.loads(frame[4 : 4 + struct.unpack("<I", frame[:4])[0]]) for frame in found]


def test_what_a_view_of_a_robot_gets() -> None:
    robot = FakeRobot()
    view = RobotView(lambda: robot, with_pool=False)
    assert view.poll(0.0) == ([{"path": [POINT]}], SLOW_INTERVAL_S)
    assert view.poll(1.0)[0] == []
    robot.way = []
    assert view.poll(2.0)[0] == [{"path": []}]
    assert robot.asked == []  # nobody asked for the pool
    view = RobotView(lambda: robot, with_pool=True)
    first = view.poll(0.0)[0]
    assert [frame["floor"] for frame in frames(first)] == ["L1"]
    assert jsons(first)["pool"] == {"floor": "L1", "lag": 0.02, "joints": {"A": (0.1,)}}
    later = view.poll(1.0)[0]
    assert frames(later) == []
    assert jsons(later)["pool"]["joints"] == {}  # known already
    assert robot.asked == [WHOLE, 5]
    robot.floor = "L2"  # after a ride: the same version number, of another floor
    assert [(frame["floor"], frame["whole"]) for frame in frames(view.poll(1.1)[0])] == [("L2", True)]
    assert robot.asked == [WHOLE, 5, 5, WHOLE]
    view = RobotView(lambda: robot, with_pool=True)
    view.poll(0.0)
    robot.hangs = True
    assert view.poll(1.0) == ([{"problem": "A does not answer"}], RETRY_S)
    assert view.poll(2.0) == ([], RETRY_S)
    robot.hangs = False
    again = view.poll(3.0)[0]
    assert jsons(again)["problem"] == ""
    assert [frame["whole"] for frame in frames(again)] == [True]


def test_a_defect_of_a_view_closes_its_page_and_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    def connect(robot: str) -> FakeRobot:
        raise KeyError("a defect")

    async def run() -> Socket:
        socket: Any = Socket([])
        with contextlib.closing(RobotViews(connect)) as views:
            await asyncio.wait_for(views.serve(socket, "R1", with_pool=False), 20.0)
        return socket

    assert asyncio.run(run()).closed != (0, "")
    assert "a view of 'R1' was disconnected" in caplog.text
    assert "a defect" in caplog.text


def test_paths_are_asked_of_robots_that_may_drive_only_and_split_at_each_change_of_floor() -> None:
    places = (("L1", 1.004, 2.0), ("L1", 3.0, 2.0), ("L2", 3.0, 2.0), ("L1", 9.0, 9.0))
    assert path_by_floor([SimpleNamespace(floor=floor, x=x, y=y) for floor, x, y in places]) == [
        {"floor": "L1", "points": [[1.0, 2.0], [3.0, 2.0]]},
        {"floor": "L2", "points": [[3.0, 2.0]]},
        {"floor": "L1", "points": [[9.0, 9.0]]},
    ]
    assert path_by_floor([]) == []
    for condition, speed, is_driving in (
        *(("IDLE", 0.0, False), ("IDLE", 0.2, True), ("RUNNING", 0.0, True), ("PAUSED", 0.0, True)),
        ("STOPPED", 0.0, False),
    ):
        moving = {"ahead": speed, "left": 0.0, "turn": 0.0}
        assert agent_is_driving({"condition": condition, "actor": {"moving": moving}}) == is_driving


@contextlib.contextmanager
def running(monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], Any]) -> Iterator[tuple[Any, SystemState]]:
    """A naming service with robots, and the state of a system whose robots answer so while they run."""
    orb: Any = SimpleNamespace(robots=[], names=lambda path: list(orb.robots) if path == ROBOTS else [])

    def ask(name: str) -> Any:
        if name not in orb.robots:
            raise NotReachable(name)
        return answer(name)

    monkeypatch.setattr(system_state, "INTERVAL_S", 0.01)
    monkeypatch.setattr(system_state, "server_state", lambda _: dict)
    monkeypatch.setattr(system_state, "robot_state", lambda _, name: lambda: ask(name))
    with contextlib.closing(SystemState(orb)) as state:
        state.start()
        yield orb, state


def test_a_defect_in_a_request_is_logged(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    with running(monkeypatch, lambda name: {}["a defect"]) as (orb, state):
        orb.robots = ["R1"]
        row = eventually(lambda: (row := state.rows()["robots"].get("R1")) and row["problem"] and row)
    assert (row["state"], row["age"], row["problem"]) == (None, None, DEFECT)
    assert "a defect" in caplog.text


def test_robots_that_left_are_forgotten_beyond_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(system_state, "MAX_GONE", 2)
    with running(monkeypatch, lambda name: {"name": name}) as (orb, state):

        def row(name: str) -> Any:
            return state.rows()["robots"].get(name, {"state": None, "problem": "", "bound": True})

        for name in ("R0", "R1", "R2", "R3"):
            orb.robots = ["R", name]
            eventually(lambda name=name: row(name)["state"])  # type: ignore[misc]
            orb.robots = ["R"]
            eventually(lambda name=name: row(name)["problem"] and not row(name)["bound"])  # type: ignore[misc]
        assert list(state.rows()["robots"]) == ["R", "R2", "R3"]
