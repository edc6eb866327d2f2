"""Objects of other processes, and copies of what they hold, also while they do not answer."""

from __future__ import annotations

import contextlib
import itertools
import threading
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.corba.conversion import floors as conversion
from robocorba.corba.remote import data_pool, live_system
from robocorba.corba.remote.data_pool import PoolFollower
from robocorba.corba.remote.live_system import LiveSystem
from robocorba.corba.remote.omni_database import RemoteFloor, RemoteFloors
from robocorba.corba.remote.remote_object import RemoteObject, translated
from robocorba.errors.maps import StaleVersion
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import RobotLost
from robocorba.errors.services import NotReachable
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.spatial.posture import Posture
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually
from tests.data_pool.places import Place


class Naming:
    """An ORB that answers the number of its `resolve` calls."""

    def __init__(self) -> None:
        self.count = 0

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> int:
        assert (name, interface, timeout_s, call_timeout_s) == ("MapEditor", RoboCorba.MapEditor, 2.0, 1.0)
        self.count += 1
        return self.count


def fail(error: Exception) -> Any:
    def operation(reference: Any) -> Any:
        raise error

    return operation


def test_it_is_resolved_again_only_after_it_did_not_answer() -> None:
    naming: Any = Naming()
    editor = RemoteObject(naming, "MapEditor", RoboCorba.MapEditor, "the map editor", 2.0, 1.0)
    assert [editor.call(lambda reference: reference) for _ in range(3)] == [1, 1, 1]
    with pytest.raises(StaleVersion, match="5"):
        editor.call(fail(RoboCorba.StaleVersion(4, 5)))
    assert editor.call(lambda reference: reference) == 1
    with pytest.raises(NotReachable, match=r"the map editor does not answer \(.*TRANSIENT"):
        editor.call(fail(CORBA.TRANSIENT()))
    assert editor.call(lambda reference: reference) == 2


def test_the_caller_chooses_the_error_of_a_failure() -> None:
    class Strange(CORBA.UserException):
        """Without a domain error."""

    with pytest.raises(RobotLost, match="the adaptor does not answer"), translated("the adaptor", RobotLost):
        raise CORBA.COMM_FAILURE()
    with pytest.raises(Strange), translated("the adaptor"):
        raise Strange()


class Database:
    """A database whose robots move with each call."""

    def __init__(self) -> None:
        self.names = ["L1", "L2"]
        self.version = 0
        self.error: Exception | None = None

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


class DatabaseNaming:
    """An ORB that resolves the database if there is one."""

    def __init__(self, database: Database) -> None:
        self.database: Database | None = database
        self.resolved: list[tuple[str, float]] = []

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> Database:
        assert interface is RoboCorba.OmniDatabase
        self.resolved.append((name, timeout_s))
        if self.database is None:
            raise NotReachable("not bound")
        return self.database


def gone() -> CORBA.SystemException:
    return CORBA.COMM_FAILURE(0, CORBA.COMPLETED_MAYBE)


def test_a_floor_is_loaded_and_then_followed() -> None:
    database = Database()
    with pytest.raises(UnknownFloor, match="L9"):
        RemoteFloor(database, "L9").follow()
    floor, database.version = RemoteFloor(database, "L1"), 0
    assert floor.follow().since == WHOLE
    second = floor.follow()
    assert (second.since, second.version) == (1, 2)
    assert (floor.view.version, floor.view.motion(1)["x"]) == (2, 2.0)
    database.error = gone()
    with pytest.raises(NotReachable, match="Omni database"):
        floor.follow()
    assert floor.view.version == 2


def test_all_floors_are_followed_unless_some_are_chosen() -> None:
    database = Database()
    naming: Any = DatabaseNaming(database)
    everything = RemoteFloors(naming)
    assert [update.floor for update in everything.follow(1.0)] == ["L1", "L2"]
    database.names = ["L2", "L3"]
    assert [(update.floor, update.since > 0) for update in everything.follow(1.0)] == [("L2", True), ("L3", False)]
    assert list(everything.views) == ["L2", "L3"]
    assert [update.floor for update in RemoteFloors(naming, ["L3"]).follow(1.0)] == ["L3"]
    with pytest.raises(UnknownFloor, match="L1"):
        RemoteFloors(naming, ["L3", "L1"]).follow(1.0)
    database.names, read = ["ground", "L2"], database.floors
    database.floors = lambda: ["L3", "L2"]  # type: ignore[method-assign]  # it is renamed after its name was read
    assert [update.floor for update in everything.follow(1.0)] == ["L2"]
    database.floors = read  # type: ignore[method-assign]
    assert [(update.floor, update.since > 0) for update in everything.follow(1.0)] == [("ground", False), ("L2", True)]


def test_after_a_failure_whole_floors_are_loaded() -> None:
    database = Database()
    naming: Any = DatabaseNaming(database)
    floors = RemoteFloors(naming, ["L1"])
    for _ in range(2):
        floors.follow(3.0)
    assert naming.resolved == [("OmniDatabase", 3.0)]
    database.error = gone()
    with pytest.raises(NotReachable):
        floors.follow(0.5)
    assert floors.views == {}
    naming.database = None
    with pytest.raises(NotReachable, match="not bound"):
        floors.follow(0.5)
    naming.database, database.error = database, None
    assert [update.since for update in floors.follow(0.5)] == [WHOLE]
    assert len(naming.resolved) == 3


class World:
    """Floors, Omni database and mission control in one. time_s: simulated."""

    def __init__(self) -> None:
        self.views: dict[str, FloorView] = {}
        self.floor = "L1"
        self.time_s, self.version = 10.0, 0
        self.reported: list[Posture] = []
        self.is_away = False
        self.timeouts_s: list[float] = []

    def follow(self, resolve_timeout_s: float) -> list[FloorUpdate]:
        self.timeouts_s.append(resolve_timeout_s)
        view = self.views.setdefault(self.floor, FloorView(self.floor))
        self.version += 1
        update = FloorUpdate(
            self.floor, view.version or WHOLE, self.version, self.time_s, 1, [], [], np.empty(0, MOTION), {}
        )
        view.apply(update)
        return [update]

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        if self.is_away:
            raise NotReachable("away")
        return [posture for posture in self.reported if posture.time > time_s]

    def scans_since(self, floor: str, time_s: float) -> list[Any]:
        return []

    def missions_since(self, version: int) -> list[Any]:
        return []


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> tuple[World, LiveSystem]:
    monkeypatch.setattr(live_system, "SENSORS_S", 0.0)
    found: Any = World()
    return found, LiveSystem(found, found, found)


def test_a_floor_that_is_gone_becomes_empty_once(system: tuple[World, LiveSystem]) -> None:
    """Else viewers and recordings keep its robots beside those of the floor that has its robots now."""
    world, live = system
    first = live.follow(0.0)
    world.floor, world.time_s, world.is_away = "ground", 10.5, True
    with pytest.raises(NotReachable):
        live.follow(0.0)
    world.is_away = False
    second = live.follow(0.0)
    assert [update.floor for update in first.updates] == ["L1"]
    here, gone = second.updates
    assert (here.floor, gone.floor, gone.since, gone.time) == ("ground", "L1", WHOLE, 10.5)
    assert (gone.came, len(gone.motions), gone.elevators) == ([], 0, {})
    assert [update.floor for update in live.follow(0.0).updates] == ["ground"]


def test_each_posture_comes_once(system: tuple[World, LiveSystem]) -> None:
    world, live = system
    world.reported = [Posture("A", 9.9, ()), Posture("B", 9.95, ())]
    assert [posture.robot for posture in live.follow(0.0).postures] == ["A", "B"]
    assert live.follow(0.0).postures == []
    world.time_s = 10.1
    world.reported = [Posture("A", 10.05, ()), Posture("B", 9.95, ()), Posture("C", 9.93, ())]  # C's is late
    assert [posture.robot for posture in live.follow(0.0).postures] == ["A", "C"]
    world.time_s = 5.0  # a server that was restored from an earlier moment
    world.reported = [Posture("A", 4.9, ())]
    assert [posture.robot for posture in live.follow(0.0).postures] == ["A"]


def test_floors_come_whole_after_updates_that_nobody_has_seen(system: tuple[World, LiveSystem]) -> None:
    world, live = system
    assert live.follow(0.0).updates[0].since == WHOLE
    assert live.follow(0.0).updates[0].since == 1
    world.is_away = True
    with pytest.raises(NotReachable):
        live.follow(0.0)
    world.is_away = False
    assert live.follow(0.0).updates[0].since == WHOLE


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


class NoOrb:
    """Nothing is called: the pool has a source of its own."""

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments, **options: None


def test_a_reader_wakes_a_pool_that_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_pool, "REST_INTERVAL_S", 600.0)
    monkeypatch.setattr(data_pool, "ATTENTION_S", 0.0)
    monkeypatch.setattr(data_pool, "ATTEND_LIMIT_S", 60.0)
    place, follower = Place(), PoolFollower(NoOrb(), "L1", rests=lambda: True)  # type: ignore[arg-type]
    follower.pool = place.pool()
    with contextlib.closing(follower.start()):
        eventually(lambda: follower.pool.snapshot(), 60.0, "the first content")
        for _ in range(3):
            place.clock.now += 5.0
            assert follower.pool.lag_s >= 5.0
            follower.attend()
            assert follower.pool.lag_s == 0.0


def test_a_reader_waits_for_an_update_that_begins_after_it_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is under way has read before."""
    monkeypatch.setattr(data_pool, "REST_INTERVAL_S", 600.0)
    monkeypatch.setattr(data_pool, "ATTEND_LIMIT_S", 60.0)
    place, follower = Place(), PoolFollower(NoOrb(), "L1", rests=lambda: True)  # type: ignore[arg-type]
    follower.pool = place.pool()
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
