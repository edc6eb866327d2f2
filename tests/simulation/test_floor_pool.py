"""Floors that threads step side by side: the same results bit for bit, errors, the faster way, the end of threads."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from robocorba.errors.simulation import CannotGrip
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
)
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation import floor_pool
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.floor_pool import KEPT_WINDOWS, MIN_SHARED_BODIES, WINDOW_STEPS, FloorPool, SharingChoice
from robocorba.simulation.physics import Contact, StepResult
from robocorba.simulation.registry import Description
from robocorba.system import cores
from tests.clock import Clock

FLOORS = ("L1", "L2", "L3")


def house() -> Building:
    """Three floors of 10 x 10 m with a table each, and an elevator in the middle with its door to the front."""
    lift = Elevator("E1", (5.0, 5.0), (2.0, 2.0), tuple(map(ElevatorDoor, FLOORS)), speed=8.0, door_time=0.3)
    square = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    floors = {}
    for level, name in enumerate(FLOORS):
        table = MapObject(f"T{level}", BoxShape((1.0, 0.6)), (2.0, 2.0), 0.3, movable=True)
        floors[name] = FloorMap(
            Floor(name, level, 4.0 * level, outline=square), GeometricalMap({}, {table.name: table})
        )
    return Building("house", floors, {"E1": lift})


class Play:
    """Robots that drive about and collide on all floors, two that grip a table, and one that rides to another floor."""

    def __init__(self, pool: FloorPool, seed: int) -> None:
        self.world = SimulatedBuilding(house(), pool)
        self._chance = np.random.default_rng(seed)
        self._add("rider", "L1", 5.0, 3.0, np.pi / 2)
        for name, y in (("left", 2.75), ("right", 1.25)):
            self._add(name, "L1", 2.0, y, 0.0)
        for floor in FLOORS:
            for row in range(8):
                for column, x in enumerate((0.6, 7.4, 8.6)):
                    self._add(f"{floor}-{row}-{column}", floor, x, 0.6 + 1.1 * row, 0.0)
        self.world.elevators.call("rider", "E1", "L3")
        self.seen: list[object] = []
        self.kinds: set[str] = set()
        self.gripped = 0

    def run(self, steps: int) -> None:
        for step in range(steps):
            self._command(step)
            events = self.world.step()
            self.kinds.update(event.kind for event in events)
            self.seen.append((tuple(events), dict(self.world.elevators.states), dict(self.world.elevators.rides)))
            for physics in self.world.occupants.floors.values():
                state = physics.snapshot
                self.seen.append((state.floor, state.time, state.names, dict(state.held), state.rows.tobytes()))

    def _command(self, step: int) -> None:
        robots = self.world.occupants.robots
        if step % 10 == 0:
            for robot in robots.values():
                ahead, left, turn = self._chance.uniform(-1.0, 1.0, 3).tolist()
                if robot.name != "rider":
                    robot.command(ahead, left, turn, 0.3)
        if step in (5, 25, 150):
            for name, y in (("left", 2.3), ("right", 1.7)):
                with contextlib.suppress(CannotGrip):
                    self.world.occupants.grip(name, "T0", (2.0, y))
                    self.gripped += 1
        ride = self.world.elevators.rides.get("rider")
        y = self.world.occupants.pose("rider").y
        if ride and ride.phase in (RidePhase.WAITING, RidePhase.BOARDING, RidePhase.RIDING):
            wanted = 3.0 if ride.phase is RidePhase.WAITING else 5.0
            robots["rider"].command(max(-1.0, min(1.0, 2 * (wanted - y))), 0.0, 0.0, 0.2)

    def _add(self, name: str, floor: str, x: float, y: float, heading: float) -> None:
        self.world.add(Description(name, Pose(floor, x, y, heading)))


@pytest.mark.parametrize("seed", range(3))
def test_any_number_of_threads_simulates_the_same_bit_for_bit(seed: int) -> None:
    plays = [Play(FloorPool(threads), seed) for threads in (1, 2, 3)]
    for play in plays:
        play.run(500)
        play.world.close()
    alone = plays[0]
    assert alone.world.occupants.pose("rider").floor == "L3"
    assert "collision" in alone.kinds
    assert alone.gripped >= 2
    for play in plays[1:]:
        assert play.seen == alone.seen
        assert play.world.record() == alone.world.record()


class FakeFloor:
    """A floor that notes the threads that step it. wait: called within a step."""

    def __init__(self, name: str, size: int = MIN_SHARED_BODIES, wait: Callable[[], object] = lambda: None) -> None:
        self.name, self.size, self.is_still, self.wait = name, size, False, wait
        self.threads: list[str] = []

    def step(self) -> StepResult:
        self.threads.append(threading.current_thread().name)
        self.wait()
        return StepResult([Contact(self.name, "")], [])


def floor_threads() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "floors"}


@pytest.fixture
def pool() -> Iterator[FloorPool]:
    before = floor_threads()
    with contextlib.closing(FloorPool(2)) as pool:
        yield pool
    assert floor_threads() <= before


def meeting() -> Callable[[], object]:
    """For the steps of two floors: each waits until the other one is under way too."""
    return threading.Barrier(2, timeout=20.0).wait


def test_floors_are_stepped_at_the_same_time_and_reported_in_their_order(pool: FloorPool) -> None:
    meet = meeting()
    floors = [FakeFloor("small", 1, meet), FakeFloor("large", 9, meet)]
    for _ in range(20):
        assert [result.contacts[0].first for result in pool.step(floors)] == ["small", "large"]
    assert set(floors[0].threads + floors[1].threads) == {threading.current_thread().name, "floors"}


def test_its_threads_run_on_all_cores(pool: FloorPool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though they are started by a thread that shares its core with others."""
    monkeypatch.setattr(cores, "_cores", None)
    cores_of: dict[str, set[int]] = {}
    meet = meeting()

    def note() -> None:
        meet()
        cores_of[threading.current_thread().name] = os.sched_getaffinity(0)

    def step() -> None:
        cores.share_one()
        pool.step([FakeFloor("small", 1, note), FakeFloor("large", 9, note)])

    simulation = threading.Thread(target=step, name="simulation")
    simulation.start()
    simulation.join()
    assert len(cores_of["simulation"]) == 1
    assert cores_of["floors"] == os.sched_getaffinity(0)


@pytest.mark.parametrize("threads", [1, 2])
def test_the_first_error_of_a_floor_is_raised_after_all_have_stepped(threads: int) -> None:
    def fail(text: str) -> Callable[[], object]:
        def wait() -> None:
            raise ValueError(text)

        return wait

    floors = [FakeFloor("good"), FakeFloor("bad", wait=fail("first")), FakeFloor("worse", wait=fail("second"))]
    floors += [FakeFloor("last")]
    with contextlib.closing(FloorPool(threads)) as pool:
        for _ in range(3):
            with pytest.raises(ValueError, match="first"):
                pool.step(floors)
    assert [len(floor.threads) for floor in floors] == [3, 3, 3, 3]


def test_an_interrupted_step_leaves_no_thread_on_a_floor(pool: FloorPool) -> None:
    meet, here = meeting(), threading.current_thread()

    def interrupted() -> None:
        meet()
        if threading.current_thread() is here:
            raise KeyboardInterrupt

    before = floor_threads()
    with pytest.raises(KeyboardInterrupt):
        pool.step([FakeFloor("A", wait=interrupted), FakeFloor("B", wait=interrupted), FakeFloor("C")])
    assert floor_threads() <= before
    meet = meeting()
    assert len(pool.step([FakeFloor("A", wait=meet), FakeFloor("B", wait=meet)])) == 2


def test_an_idle_thread_ends_and_another_one_starts(monkeypatch: pytest.MonkeyPatch, pool: FloorPool) -> None:
    monkeypatch.setattr(floor_pool, "IDLE_LIMIT_S", 0.01)
    before = floor_threads()
    for _ in range(3):
        meet = meeting()
        pool.step([FakeFloor("A", wait=meet), FakeFloor("B", wait=meet)])
        for thread in floor_threads() - before:
            thread.join(60.0)
        assert floor_threads() <= before


# ---- the choice ----


def windows(choice: SharingChoice, count: int, alone_s: float, shared_s: float, passed_s: float = 0.0) -> list[bool]:
    """The choices for `count` windows in which steps take these times [s], `passed_s` after each other."""
    made, now = [], 0.0
    for _ in range(count):
        made.append(choice.shares)
        for _ in range(WINDOW_STEPS):
            took = shared_s if choice.shares else alone_s
            choice.record(choice.shares, now, now + took)
            now += took + passed_s
    return made


def test_the_faster_way_is_taken_and_the_other_one_tried_again() -> None:
    choice = SharingChoice()
    windows(choice, 2 * KEPT_WINDOWS, alone_s=2.0, shared_s=1.0)
    assert 0.9 < np.mean(windows(choice, 1000, alone_s=2.0, shared_s=1.0)) < 1.0
    windows(choice, 200, alone_s=1.0, shared_s=2.0)  # other processes came
    assert 0.0 < np.mean(windows(choice, 1000, alone_s=1.0, shared_s=2.0)) < 0.1


def test_nothing_is_shared_while_steps_take_little_of_the_time() -> None:
    choice = SharingChoice()
    assert not any(windows(choice, 100, alone_s=0.001, shared_s=0.0005, passed_s=0.019))
    assert any(windows(choice, 100, alone_s=0.001, shared_s=0.0005))
    windows(choice, 1, alone_s=0.001, shared_s=0.0005, passed_s=0.019)
    assert not choice.shares


def test_empty_still_and_small_floors_need_no_other_thread(pool: FloorPool) -> None:
    before, clock = floor_threads(), Clock()
    floors = [FakeFloor("empty", 0), FakeFloor("busy"), FakeFloor("still")]
    floors[2].is_still = True
    assert len(pool.step(floors)) == 3
    pool.step([])

    def step() -> None:
        clock.now += 1.0

    small = [FakeFloor("A", 900, step), FakeFloor("B", MIN_SHARED_BODIES - 1)]
    with contextlib.closing(FloorPool(clock=clock)) as choosing:
        for _ in range(3 * WINDOW_STEPS):
            choosing.step(small)  # though sharing would pay
    assert floor_threads() <= before
    assert {thread for floor in small for thread in floor.threads} == {threading.current_thread().name}
