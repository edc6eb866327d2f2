"""Changes of a data pool since a version, for readers that have seen that version."""

from __future__ import annotations

from robocorba.map_editor.spatial.floor_update import WHOLE
from robocorba.robot.data_pool.snapshot import MAX_UPDATES
from tests.robot.data_pool.places import Place, populated


def drive(place: Place, name: str, seconds: float = 0.1) -> None:
    place.world.occupants.robots[name].command(0.3, 0.0, 0.0, 1.0)
    place.run(seconds)


def test_only_what_moved_is_sent() -> None:
    place = populated("A", "B")
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
    drive(place, "A")
    pool.follow()
    now = pool.snapshot()
    pool.change_floor("L2")
    update = pool.snapshot().changes(now.version)
    assert (update.floor, update.since) == ("L2", WHOLE)


def test_memory_of_updates_is_bounded() -> None:
    place = populated("A")
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
