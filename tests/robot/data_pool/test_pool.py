"""The data pool, beside what tests/orb/test_pool_follower.py tries: names, changes during requests, memory, threads."""

from __future__ import annotations

import gc
import itertools
import math
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.model import MapObject
from robocorba.map_editor.spatial.floor_update import WHOLE
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.snapshot import MAX_UPDATES
from tests.robot.data_pool.places import Place, populated, same
from tests.simulation.places import robot


def test_robots_and_objects_by_name() -> None:
    place = populated("A")
    pool = place.loaded_pool()
    assert {item.name: item.is_movable for item in pool.snapshot().objects()} == {"S1": False, "T1": True}
    assert [item.name for item in pool.snapshot().objects("T*")] == ["T1"]
    assert pool.snapshot().objects("t?") == []
    table, shelf = pool.snapshot().object("T1"), pool.snapshot().object("S1")
    assert table and shelf
    assert (table.x, table.y, table.heading, table.vx) == (2.0, 2.0, 0.3, 0.0)
    assert (table.mass_kg, shelf.mass_kg) == (pytest.approx(5.4), 0.0)
    assert np.sort(shelf.corners, axis=0) == pytest.approx(np.array([(7.5, 7.7), (7.5, 7.7), (8.5, 8.3), (8.5, 8.3)]))
    assert [pool.snapshot().object(name) for name in ("A", "plate", "W1", "")] == [None] * 4
    assert [pool.snapshot().robot(name) for name in ("T1", "")] == [None] * 2
    assert list(pool.snapshot().elevators) == ["E1"]
    with pytest.raises(TypeError):
        pool.snapshot().elevators["E1"] = pool.snapshot().elevators["E1"]  # type: ignore[index]
    with pytest.raises(ValueError, match="read-only"):
        pool.snapshot().motions["x"] = 0.0


def test_an_unknown_floor_is_refused_and_a_floor_may_change_during_a_request() -> None:
    place = Place()
    pool = place.loaded_pool()
    before = pool.snapshot()
    with pytest.raises(UnknownFloor, match="L9"):
        pool.change_floor("L9")
    assert pool.snapshot() is before
    nowhere = place.loaded_pool("L9")
    assert "L9" in nowhere.problem
    assert nowhere.lag_s == math.inf
    place = Place()
    pool = place.pool("L1")
    place.meanwhile = lambda: pool.change_floor("L2")
    pool.follow()
    assert pool.floor == "L2"
    assert same(pool, place)


def test_the_lag_grows_and_the_floor_can_change_while_source_or_map_do_not_answer() -> None:
    place = populated("A")
    world, pool = place.world, place.pool()
    place.is_away = True
    pool.follow()
    assert (pool.lag_s, pool.snapshot().is_known) == (math.inf, False)
    with pytest.raises(NotReachable, match=r"L1.*away"):
        pool.loaded_snapshot()
    place.is_away = False
    pool.follow()
    place.clock.now += 0.25
    assert pool.lag_s == 0.25
    before = pool.snapshot()
    place.is_away = True
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 1.0)
    for _ in range(3):
        place.clock.now += 1.0
        place.run(0.2)
        pool.follow()
    assert (pool.lag_s, pool.snapshot()) == (3.25, before)
    assert "away" in pool.problem
    assert pool.snapshot().nearest_non_robot(1.0, 1.0)
    place.is_away = False
    pool.follow()
    assert (pool.lag_s, pool.problem) == (0.0, "")
    assert same(pool, place)
    first, now = before.robot("A"), pool.snapshot().robot("A")
    assert first and now and first.x == 7.0 < now.x  # what was read before has not changed
    assert now.vx > 0.1 and before.time < pool.snapshot().time
    for floor, is_away, problem in (("L2", True, "away"), ("L1", False, "editor")):
        place.is_away, place.is_editor_away = is_away, not is_away
        for _ in range(2):
            assert not pool.change_floor(floor)
            assert (pool.floor, pool.lag_s, pool.snapshot().bodies.all) == (floor, math.inf, ())
            assert problem in pool.problem
        place.is_away = place.is_editor_away = False
        pool.follow()
        assert same(pool, place)
        assert pool.change_floor(floor)


def test_an_object_that_becomes_movable_on_the_map_is_so_in_the_pool() -> None:
    place = Place()
    pool = place.loaded_pool()
    shelf = place.world.building.floors["L1"].geometrical.objects["S1"]
    place.world.update(place.world.building.with_element("L1", MapObject("S1", shelf.shape, shelf.at, movable=True)))
    pool.follow_map()
    pool.follow()
    assert {item.name: item.is_movable for item in pool.snapshot().objects()} == {"S1": True, "T1": True}
    place.is_editor_away = True
    with pytest.raises(NotReachable):
        pool.follow_map()


def crowded(count: int) -> tuple[Place, DataPool]:
    """This number of robots on each floor, and a pool of the lower one."""
    place = Place()
    for number, floor in itertools.product(range(count), ("L1", "L2")):
        place.world.add(robot(f"{floor}-{number}", floor, 4.0 + 1.0 * number, 1.5))
    place.world.refresh()
    return place, place.pool("L1")


def test_a_floor_that_the_robot_has_left_takes_no_memory() -> None:
    _, pool = crowded(3)
    pool.follow()
    before = weakref.ref(pool.snapshot())
    pool.change_floor("L2")
    gc.collect(0)
    assert before() is None


def test_readers_never_see_two_floors_at_once() -> None:
    place, pool = crowded(3)
    pool.follow()
    is_over = threading.Event()
    floors_seen: set[str] = set()

    def read() -> None:
        while not is_over.wait(0.0005):
            snapshot = pool.snapshot()
            floors_seen.add(snapshot.floor)
            assert snapshot.walls and snapshot.walls.floor == snapshot.floor
            assert [item.name for item in snapshot.robots] == [f"{snapshot.floor}-{number}" for number in range(3)]
            assert [other.name for _, other in snapshot.robots_near(5.0, 1.5, 0.1)] == [f"{snapshot.floor}-1"]

    def follow() -> None:
        while not is_over.wait(0.001):
            pool.follow()

    with ThreadPoolExecutor() as threads:
        tasks = [threads.submit(task) for task in (read, read, follow)]
        for turn in range(60):
            pool.change_floor(("L2", "L1")[turn % 2])
        is_over.set()
    for task in tasks:
        task.result()
    assert floors_seen == {"L1", "L2"}
    assert pool.floor == "L1"
    pool.follow()
    assert same(pool, place)


def test_an_unknown_version_gets_the_whole_floor_and_memory_of_updates_is_bounded() -> None:
    place = populated("A")
    pool = place.pool()
    assert pool.snapshot().changes(5).version == WHOLE  # nothing is loaded yet
    pool.follow()
    now = pool.snapshot()
    for version in (1, now.version - 1, now.version + 1):
        assert now.changes(version).since == WHOLE
    place.start_again()
    pool.follow()  # the database does not know the pool's version
    assert pool.snapshot().changes(now.version).since == WHOLE
    place.drive("A", 0.1)
    pool.follow()
    now = pool.snapshot()
    pool.change_floor("L2")
    update = pool.snapshot().changes(now.version)
    assert (update.floor, update.since) == ("L2", WHOLE)
    place = populated("A")
    pool = place.loaded_pool()
    first = pool.snapshot().version
    for _ in range(MAX_UPDATES + 10):
        place.drive("A", 0.02, (0.1, 0.0, 0.0))
        pool.follow()
    now = pool.snapshot()
    assert len(now.recent) == MAX_UPDATES
    assert now.changes(first).since == WHOLE
    assert now.changes(now.recent[0].since).since == now.recent[0].since
