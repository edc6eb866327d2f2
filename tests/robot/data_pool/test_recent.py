"""Changes of a data pool since a version, for readers that have seen that version."""

from __future__ import annotations

import numpy as np

from robocorba.map_editor.spatial.floor_update import WHOLE, FloorView
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.snapshot import MAX_UPDATES
from tests.robot.data_pool.places import Place
from tests.simulation.places import robot


def place_with_robots(*names: str) -> Place:
    place = Place()
    for index, name in enumerate(names):
        place.world.add(robot(name, x=7.0, y=1.0 + index))
    place.world.refresh()
    return place


def drive(place: Place, name: str, seconds: float = 0.1) -> None:
    place.world.occupants.robots[name].command(0.3, 0.0, 0.0, 1.0)
    place.run(seconds)


def equals(view: FloorView, pool: DataPool) -> bool:
    """Whether a copy has the pool's content."""
    whole = FloorView(view.floor)
    whole.apply(pool.snapshot().as_update())
    assert (view.version, view.time, view.map_version) == (whole.version, whole.time, whole.map_version)
    assert view.bodies == whole.bodies
    assert view.elevators == whole.elevators
    assert np.array_equal(np.sort(view.motions, order="number"), np.sort(whole.motions, order="number"))
    return True


def test_a_reader_follows_by_changes_however_seldom_it_asks() -> None:
    place = place_with_robots("A", "B", "C")
    pool = place.pool()
    pool.follow()
    often, seldom = FloorView("L1"), FloorView("L1")
    for view in (often, seldom):
        view.apply(pool.snapshot().changes(WHOLE))
    begun = seldom.version
    happenings = (
        lambda: drive(place, "A"),
        lambda: place.world.remove("B"),
        lambda: place.world.add(robot("D", x=5.0)),
        lambda: place.world.place("C", Pose("L2", 2.0, 2.0, 0.0)),
        lambda: place.world.place("C", Pose("L1", 2.0, 6.0, 0.0)),
        lambda: place.world.place("T1", Pose("L1", 1.0, 8.0, 0.0)),
        lambda: place.world.elevators.call("A", "E1", "L2"),
        lambda: place.run(1.0),
        lambda: place.world.remove("D"),
    )
    for happens in happenings:
        happens()
        place.world.refresh()
        pool.follow()
        update = pool.snapshot().changes(often.version)
        assert update.since == often.version
        often.apply(update)
        assert equals(often, pool)
    update = pool.snapshot().changes(begun)
    assert update.since == begun
    seldom.apply(update)
    assert equals(seldom, pool)


def test_only_what_moved_is_sent() -> None:
    place = place_with_robots("A", "B")
    pool = place.pool()
    pool.follow()
    before = pool.snapshot()
    drive(place, "B")
    pool.follow()
    update = pool.snapshot().changes(before.version)
    assert update.motions["number"].tolist() == [place.world.occupants.robots["B"].number]
    assert (update.came, update.went, update.elevators) == ([], [], {})
    now = pool.snapshot()
    nothing = now.changes(now.version)
    assert (nothing.since, nothing.version, len(nothing.motions)) == (now.version, now.version, 0)
    assert nothing.time == now.time > before.time
    assert before.changes(before.version).time == before.time  # a snapshot stays as it was


def test_an_unknown_version_gets_the_whole_floor() -> None:
    place = place_with_robots("A")
    pool = place.pool()
    assert pool.snapshot().changes(5).version == WHOLE  # nothing is loaded yet
    pool.follow()
    now = pool.snapshot()
    for version in (1, now.version - 1, now.version + 1):
        assert now.changes(version).since == WHOLE
    place.start_again()
    pool.follow()  # the database does not know the pool's version
    assert pool.snapshot().changes(now.version).since == WHOLE
    drive(place, "A")
    pool.follow()
    now = pool.snapshot()
    pool.change_floor("L2")
    update = pool.snapshot().changes(now.version)
    assert (update.floor, update.since) == ("L2", WHOLE)


def test_memory_of_updates_is_bounded() -> None:
    place = place_with_robots("A")
    pool = place.pool()
    pool.follow()
    first = pool.snapshot().version
    for _ in range(MAX_UPDATES + 10):
        place.world.occupants.robots["A"].command(0.1, 0.0, 0.0, 1.0)
        place.run(0.02)
        pool.follow()
    now = pool.snapshot()
    assert len(now.recent) == MAX_UPDATES
    assert now.changes(first).since == WHOLE
    assert now.changes(now.recent[0].since).since == now.recent[0].since
