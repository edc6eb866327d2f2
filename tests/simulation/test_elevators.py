"""Elevators of the simulated building: rides, parties, doors, and what is in cabins."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from robocorba.errors.simulation import PlaceTaken
from robocorba.map_editor.model import BoxShape, ElementKind, Floor, MapObject
from robocorba.map_editor.spatial.elevator_state import Doors
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.physics import FloorPhysics
from tests.simulation.places import enter, run, tower


def into_the_cabin(world: SimulatedBuilding, name: str, y: float) -> None:
    """Drive a robot that faces the doors of E1 straight in."""
    while world.elevators.rides[name].phase is RidePhase.WAITING:
        world.step()
    while world.occupants.pose(name).y < y - 0.05:
        world.occupants.robots[name].command(max(0.1, min(0.5, y - world.occupants.pose(name).y)), 0.0, 0.0, 0.2)
        world.step()
    world.occupants.robots[name].brake()


def until(world: SimulatedBuilding, phase: RidePhase) -> None:
    """Step until the ride of A is in a phase."""
    while world.elevators.rides["A"].phase is not phase:
        world.step()


def cabin(world: SimulatedBuilding) -> tuple[str, Doors]:
    return world.elevators.cabins["E1"].floor, world.elevators.cabins["E1"].doors


def stands_before_closed_doors(world: SimulatedBuilding, floor: str) -> bool:
    """Whether a robot A that drives at them gets no further."""
    enter(world, "A", floor, 5.0, 2.5, math.pi / 2)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(world, 6.0)
    return world.occupants.pose("A").y == pytest.approx(3.6, abs=0.02)


def with_a_box(at: tuple[float, float]) -> SimulatedBuilding:
    """The tower with a movable box of 0.6 m by 0.4 m on L2; the doors of E1 close at y = 4."""
    return SimulatedBuilding(tower().with_element("L2", MapObject("box", BoxShape((0.6, 0.4)), at, movable=True)))


@pytest.mark.parametrize("y", [4.0, 5.5])
def test_doors_with_something_between_or_behind_them_on_the_map_begin_open(y: float) -> None:
    world = with_a_box((5.0, y))
    run(world, 5.0)
    assert cabin(world) == ("L2", Doors.OPEN)
    assert world.occupants.object_pose("box") == pytest.approx(Pose("L2", 5.0, y, 0.0), abs=1e-9)
    assert stands_before_closed_doors(world, "L1")  # closed on the other floor


def test_a_lone_robot_does_not_board_past_an_object_between_the_doors() -> None:
    world = with_a_box((5.0, 4.0))
    enter(world, "A", "L2", 2.0, 2.0)
    enter(world, "B", "L2", 5.0, 3.2)
    world.elevators.call("A", "E1", "L1")
    run(world, 15.0)
    assert world.elevators.rides["A"].phase is RidePhase.WAITING
    world.occupants.grip("B", "box", (5.0, 3.8))  # it will not stay there
    run(world, 15.0)
    assert world.elevators.rides["A"].phase is RidePhase.BOARDING


def test_a_restart_leaves_doors_open_that_are_recorded_as_open_only() -> None:
    """What was between them on the map may have been carried away."""
    world = with_a_box((5.0, 4.0))
    world.place("box", Pose("L2", 5.0, 2.0, 0.0))
    run(world, 10.0)
    assert world.elevators.cabins["E1"].doors is Doors.CLOSED
    again = with_a_box((5.0, 4.0))
    again.restore(world.record(), [])
    assert cabin(again) == ("L2", Doors.CLOSED)
    again.place("box", Pose("L2", 2.0, 8.0, 0.0))
    assert stands_before_closed_doors(again, "L2")


def test_doors_never_close_on_arms_that_hold_something() -> None:
    """The robot stands before the doors, the box behind them; nothing but its arms is between them."""
    world = with_a_box((5.0, 2.5))
    enter(world, "A", "L2", 5.0, 1.8, math.pi / 2)
    world.place("box", Pose("L2", 5.0, 2.7, 0.0))
    world.occupants.grip("A", "box", (5.0, 2.5))
    world.elevators.call("A", "E1", "L1")
    into_the_cabin(world, "A", 3.45)
    run(world, 0.5)
    gap = (
        world.occupants.pose("A").y + world.occupants.robots["A"].description.radius_m,
        world.occupants.object_pose("box").y - 0.2,
    )
    assert gap[0] < 4.0 < gap[1]
    run(world, 30.0)
    assert world.elevators.cabins["E1"].doors is Doors.OPEN
    assert (world.occupants.robots["A"].holding, world.occupants.robots["A"].collisions) == ("box", 0)
    world.occupants.release("A")
    world.place("box", Pose("L2", 2.0, 2.0, 0.0))
    run(world, 5.0)
    assert world.elevators.cabins["E1"].doors is Doors.CLOSED


def test_an_object_that_is_left_in_the_cabin_keeps_its_doors_open() -> None:
    """As after carriers have put it down there."""
    world = with_a_box((2.0, 2.0))
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2", "party", 1)
    into_the_cabin(world, "A", 4.75)
    until(world, RidePhase.RIDING)
    world.place("box", Pose("L1", 5.0, 5.5, 0.0))
    world.occupants.grip("A", "box", (5.0, 5.3))
    while world.elevators.states["E1"].floor:
        world.step()
    enter(world, "B", "L1", 5.0, 2.0)
    world.elevators.call("B", "E1", "L2")
    world.occupants.release("A")
    world.elevators.cancel("A")
    run(world, 35.0)
    assert cabin(world) == ("L2", Doors.OPEN)
    world.occupants.grip("A", "box", (5.0, 5.3))  # and may be carried out
    run(world, 15.0)
    assert cabin(world) == ("L2", Doors.OPEN)
    while world.occupants.pose("A").y > 2.5:
        assert world.elevators.cabins["E1"].doors is Doors.OPEN or world.occupants.pose("A").y < 3.1
        world.occupants.robots["A"].command(-0.3, 0.0, 0.0, 0.2)
        world.step()
    assert "boarding" in [event.kind for event in run(world, 40.0)]
    assert world.occupants.robots["A"].holding == "box"


def test_a_cabin_that_has_closed_over_an_object_opens_again() -> None:
    """For robots that ride with it, this waits until they have arrived or have given up."""
    world = with_a_box((2.0, 2.0))
    run(world, 1.0)
    world.place("box", Pose(world.elevators.cabins["E1"].floor, 5.0, 5.5, 0.0))
    record = world.record()
    run(world, 5.0)
    assert world.elevators.cabins["E1"].doors is Doors.OPEN
    again = with_a_box((2.0, 2.0))
    again.restore(record, [])
    run(again, 5.0)
    assert again.elevators.cabins["E1"].doors is Doors.OPEN


def test_riders_keep_their_grips_and_have_left_the_cabin_once_what_they_hold_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = MapObject("T2", BoxShape((0.4, 0.4)), (2.0, 2.0), movable=True)
    world = SimulatedBuilding(tower().with_element("L1", table))
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2")
    into_the_cabin(world, "A", 4.75)
    until(world, RidePhase.RIDING)
    world.place("T2", Pose("L1", 5.0, 5.5, 0.0))
    world.occupants.grip("A", "T2", (5.0, 5.3))
    seen = []

    def looked_at_before(change: Callable[..., Any]) -> Callable[..., Any]:
        """`change`, before which another thread reads the state of A."""

        def looking(*args: Any) -> Any:
            seen.append(world.occupants.robots["A"].holding)
            return change(*args)

        return looking

    for name in ("add_robot", "add_object", "remove", "grip", "step"):
        monkeypatch.setattr(FloorPhysics, name, looked_at_before(getattr(FloorPhysics, name)))
    until(world, RidePhase.ALIGHTING)
    assert (world.occupants.pose("A").floor, world.occupants.objects["T2"].floor) == ("L2", "L2")
    with_object_in_doors = 0
    while "A" in world.elevators.rides:
        assert world.elevators.cabins["E1"].doors is Doors.OPEN
        world.occupants.robots["A"].command(-0.3, 0.0, 0.0, 0.2)
        world.step()
        with_object_in_doors += world.occupants.pose("A").y < 4.0 - 0.5
    assert with_object_in_doors > 10
    assert set(seen) == {"T2"}
    assert world.occupants.object_pose("T2").y < 4.0 - 0.2


def test_the_shaft_of_an_elevator_blocks_no_floor_above_it() -> None:
    world = SimulatedBuilding(tower())
    world.update(world.building.with_element("", Floor("L3", 3, 8.0)))
    enter(world, "A", "L3", 4.0, 5.0)
    world.remove("A")
    world.update(world.building.with_changes([(ElementKind.FLOOR, "", "L2", Floor("L2", 4, 12.0))]))
    with pytest.raises(PlaceTaken):
        enter(world, "A", "L3", 4.0, 5.0)
