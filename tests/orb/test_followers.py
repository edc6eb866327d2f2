"""Objects of other processes, and copies of what they hold, also while they do not answer."""

from __future__ import annotations

import contextlib
import itertools
import threading
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.console.corba import live_system
from robocorba.console.corba.live_system import LiveSystem
from robocorba.errors.maps import StaleVersion
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import RobotLost
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.posture import Posture
from robocorba.orb.remote_object import RemoteObject, translated
from robocorba.robot.corba import remote_data_pool as data_pool
from robocorba.robot.corba.remote_data_pool import PoolFollower
from robocorba.simulation.corba import floors as conversion
from robocorba.simulation.corba.remote_database import RemoteFloors
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.continuous_scans import ContinuousScans
from robocorba.simulation.system_view import RobotPlace
from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from testkit.simulation import RemoteFloor
from tests.robot.data_pool.places import Place
from tests.simulation.places import scan


def test_it_is_resolved_again_only_after_it_did_not_answer() -> None:
    resolved: list[tuple[Any, ...]] = []

    def resolve(*arguments: Any) -> int:
        resolved.append(arguments)
        return len(resolved)

    def fail(error: Exception) -> None:
        raise error

    naming: Any = SimpleNamespace(resolve=resolve)
    editor = RemoteObject(naming, "MapEditor", RoboCorba.MapEditor, "the map editor", 2.0, 1.0)
    assert [editor.call(lambda reference: reference) for _ in range(3)] == [1, 1, 1]
    with pytest.raises(StaleVersion, match="5"):
        editor.call(lambda reference: fail(RoboCorba.StaleVersion(4, 5)))
    assert editor.call(lambda reference: reference) == 1
    with pytest.raises(NotReachable, match=r"the map editor does not answer \(.*TRANSIENT"):
        editor.call(lambda reference: fail(CORBA.TRANSIENT()))
    assert editor.call(lambda reference: reference) == 2
    assert resolved == [("MapEditor", RoboCorba.MapEditor, 2.0, 1.0)] * 2

    class Strange(CORBA.UserException):
        """Without a domain error."""

    with pytest.raises(RobotLost, match="the adaptor does not answer"), translated("the adaptor", RobotLost):
        raise CORBA.COMM_FAILURE()
    with pytest.raises(Strange), translated("the adaptor"):
        raise Strange()


class Database:
    """A database whose robots move with each call, and the ORB that resolves it if it `is_bound`."""

    def __init__(self) -> None:
        self.names, self.version, self.is_bound = ["L1", "L2"], 0, True
        self.error: Exception | None = None
        self.resolved: list[tuple[str, float]] = []

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> Database:
        assert interface is RoboCorba.OmniDatabase
        self.resolved.append((name, timeout_s))
        if not self.is_bound:
            raise NotReachable("not bound")
        return self

    def floors(self) -> list[str]:
        if self.error:
            raise self.error
        return self.names

    def getFloor(self, floor: str) -> Any:
        return self.floorChanges(floor, WHOLE)

    def floorChanges(self, floor: str, since: int) -> Any:
        if self.error:
            raise self.error
        if floor not in self.names:
            raise RoboCorba.UnknownFloor("floorName", floor, self.names)
        self.version += 1
        came = [Body(1, BodyKind.ROBOT, "A", 0.4, (), 127.0)] if since == WHOLE else []
        rows = np.array([(1, 0.0, 0.0, 0.0, float(self.version), 0.0, 0.0)], MOTION)
        return conversion.update(FloorUpdate(floor, since, self.version, 0.1, 1, came, [], rows, {}))


GONE = CORBA.COMM_FAILURE(0, CORBA.COMPLETED_MAYBE)


def test_floors_are_followed() -> None:
    database = Database()
    with pytest.raises(UnknownFloor, match="L9"):
        RemoteFloor(database, "L9").follow()
    floor = RemoteFloor(database, "L1")
    assert floor.follow().since == WHOLE
    second = floor.follow()
    assert (second.since, second.version) == (1, 2)
    assert (floor.view.version, floor.view.motion(1)["x"]) == (2, 2.0)
    database.error = GONE
    with pytest.raises(NotReachable, match="Omni database"):
        floor.follow()
    assert floor.view.version == 2
    database: Any = Database()
    everything = RemoteFloors(database)

    def followed() -> list[tuple[str, bool]]:
        return [(update.floor, update.since > 0) for update in everything.follow(1.0)]

    assert followed() == [("L1", False), ("L2", False)]
    database.names = ["L2", "L3"]
    assert followed() == [("L2", True), ("L3", False)]
    assert list(everything.views) == ["L2", "L3"]
    assert [update.floor for update in RemoteFloors(database, ["L3"]).follow(1.0)] == ["L3"]
    with pytest.raises(UnknownFloor, match="L1"):
        RemoteFloors(database, ["L3", "L1"]).follow(1.0)
    database.names, read = ["ground", "L2"], database.floors
    database.floors = lambda: ["L3", "L2"]  # it is renamed after its name was read
    assert followed() == [("L2", True)]
    database.floors = read
    assert followed() == [("ground", False), ("L2", True)]
    database: Any = Database()
    floors = RemoteFloors(database, ["L1"])
    for _ in range(2):
        floors.follow(3.0)
    assert database.resolved == [("OmniDatabase", 3.0)]
    database.error = GONE
    with pytest.raises(NotReachable):
        floors.follow(0.5)
    assert floors.views == {}
    database.is_bound = False
    with pytest.raises(NotReachable, match="not bound"):
        floors.follow(0.5)
    database.is_bound, database.error = True, None
    assert [update.since for update in floors.follow(0.5)] == [WHOLE]
    assert len(database.resolved) == 3


class World:
    """Floors, Omni database and mission control in one. time_s: simulated."""

    def __init__(self) -> None:
        self.views: dict[str, FloorView] = {}
        self.floor, self.time_s, self.version, self.is_away = "L1", 10.0, 0, False
        self.reported, self.timeouts_s = list[Posture](), list[float]()
        self.scans_since = self.missions_since = lambda *arguments: []

    def follow(self, resolve_timeout_s: float) -> list[FloorUpdate]:
        self.timeouts_s.append(resolve_timeout_s)
        view = self.views.setdefault(self.floor, FloorView(self.floor))
        self.version += 1
        since, nothing = view.version or WHOLE, np.empty(0, MOTION)
        update = FloorUpdate(self.floor, since, self.version, self.time_s, 1, [], [], nothing, {})
        view.apply(update)
        return [update]

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        if self.is_away:
            raise NotReachable("away")
        return [posture for posture in self.reported if posture.time > time_s]


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> tuple[World, LiveSystem]:
    monkeypatch.setattr(live_system, "SENSORS_S", 0.0)
    found: Any = World()
    return found, LiveSystem(found, found, found)


def test_a_floor_that_is_gone_becomes_empty_once(system: tuple[World, LiveSystem]) -> None:
    """Else viewers and recordings keep its robots beside those of the floor that has its robots now. Floors come whole
    after updates that nobody has seen."""
    world, live = system

    def fail_once() -> None:
        world.is_away = True
        with pytest.raises(NotReachable):
            live.follow(0.0)
        world.is_away = False

    assert [(update.floor, update.since) for update in live.follow(0.0).updates] == [("L1", WHOLE)]
    assert live.follow(0.0).updates[0].since == 1
    world.floor, world.time_s = "ground", 10.5
    fail_once()
    here, gone = live.follow(0.0).updates
    assert (here.floor, gone.floor, gone.since, gone.time) == ("ground", "L1", WHOLE, 10.5)
    assert (gone.came, len(gone.motions), gone.elevators) == ([], 0, {})
    assert [(update.floor, update.since > 0) for update in live.follow(0.0).updates] == [("ground", True)]
    fail_once()
    assert [update.since for update in live.follow(0.0).updates] == [WHOLE]


def test_each_posture_comes_once(system: tuple[World, LiveSystem]) -> None:
    world, live = system

    def seen(time_s: float, *reported: tuple[str, float]) -> list[str]:
        world.time_s, world.reported = time_s, [Posture(*posture, ()) for posture in reported]
        return [posture.robot for posture in live.follow(0.0).postures]

    assert seen(10.0, ("A", 9.9), ("B", 9.95)) == ["A", "B"]
    assert seen(10.0, ("A", 9.9), ("B", 9.95)) == []
    assert seen(10.1, ("A", 10.05), ("B", 9.95), ("C", 9.93)) == ["A", "C"]  # C's is late
    assert seen(5.0, ("A", 4.9)) == ["A"]  # a server that was restored from an earlier moment


def test_scans_of_actual_robots_come_once_while_scans_are_wanted(
    system: tuple[World, LiveSystem], monkeypatch: pytest.MonkeyPatch
) -> None:
    world, live = system
    asked: list[bool] = []

    def read(robots: list[Any], limit_s: float | None = None, with_virtual: bool = True) -> list[RobotScan]:
        asked.append(with_virtual)
        return [scan("A", world.time_s, is_virtual=False)]

    monkeypatch.setattr(live, "_sensed", SimpleNamespace(read=read, actual=frozenset({"A"})))
    for time_s, wanted, came in ((10.0, True, [10.0]), (10.0, True, []), (10.1, True, [10.1]), (10.2, False, [])):
        world.time_s, live.with_scans = time_s, wanted
        found = live.follow(0.0).scans
        assert [(each.time, each.is_virtual) for each in found] == [(time_s, False) for time_s in came]
    assert (asked, live.actual) == ([False] * 3, {"A"})


def test_continuous_lasers_are_of_virtual_robots_that_scan_nothing_themselves() -> None:
    asked: list[list[str]] = []
    places = {name: RobotPlace(name, "L1", 1.0, 2.0, 0.0, 0.0, (0.0, 0.0, 0.0), 5.0) for name in "ABC"}
    times = itertools.count(5.0, 0.1)

    def scans_of(robots: Any, time_s: float) -> list[RobotScan]:
        asked.append([name for name, _ in robots])
        return [scan(name, time_s) for name, _ in robots]

    lasers = ContinuousScans(scans_of, lambda: (next(times), places), 1000.0, lambda: {"A"})
    with contextlib.closing(lasers):
        eventually(lambda: asked, 60.0, "scans")
        lasers.note([scan("B", 1e9)])
        lasers.note([scan("C", next(times))])
        eventually(lambda: ["B"] in asked, 60.0, "that C scans itself")
        eventually(lambda: asked[-1] == ["B", "C"], 60.0, "that C has ended that")
    assert asked[0] == ["B", "C"] and not any("A" in names for names in asked)
    assert [each.time for each in lasers.take()] == [5.0, 5.0]


def test_a_server_that_restarts_is_waited_for_at_the_beginning(system: tuple[World, LiveSystem]) -> None:
    world, live = system
    world.is_away = True
    with pytest.raises(NotReachable):
        live.begin(0.3)
    # No attempt may go on for longer than the rest of the limit.
    assert world.timeouts_s[0] <= 0.3
    assert world.timeouts_s == sorted(world.timeouts_s, reverse=True)
    assert len(set(world.timeouts_s)) == len(world.timeouts_s)
    threading.Timer(0.3, lambda: setattr(world, "is_away", False)).start()
    assert live.begin(60.0).updates[0].since == WHOLE


@pytest.fixture
def place() -> Place:
    return Place()


@pytest.fixture
def follower(place: Place, monkeypatch: pytest.MonkeyPatch) -> PoolFollower:
    """Of a pool with a source of its own: nothing is called."""
    for name, value in (("REST_INTERVAL_S", 600.0), ("ATTEND_LIMIT_S", 60.0)):
        monkeypatch.setattr(data_pool, name, value)
    follower = PoolFollower(MagicMock(), "L1", rests=lambda: True)
    follower.pool = place.pool()
    return follower


def test_a_reader_waits_for_an_update_that_begins_after_it_asked(
    place: Place, follower: PoolFollower, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is under way has read before."""
    follow, begun = follower.pool.follow, itertools.count()
    have_read, may_end = [threading.Event() for _ in range(2)], [threading.Event() for _ in range(2)]

    def slow() -> None:
        number = min(next(begun), 1)
        follow()
        have_read[number].set()
        assert may_end[number].wait(60.0)

    monkeypatch.setattr(follower.pool, "follow", slow)
    with contextlib.closing(follower.start()):
        assert have_read[0].wait(60.0)
        place.clock.now += 5.0
        reader = threading.Thread(target=follower.attend)
        reader.start()
        eventually(lambda: not follower._is_resting, 60.0, "the reader's question")
        may_end[0].set()
        assert have_read[1].wait(60.0)
        assert reader.is_alive()
        may_end[1].set()
        reader.join(60.0)
        assert not reader.is_alive()
        assert follower.pool.lag_s == 0.0
