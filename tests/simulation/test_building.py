"""The simulated building: robots, velocity commands, rides, grips, edits of the map, records."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import (
    CannotGrip,
    InvalidChoice,
    InvalidCommand,
    InvalidRide,
    PlaceTaken,
    UnknownBody,
)
from robocorba.maps.model import BoxShape, ElementKind, Floor, MapObject, Wall
from robocorba.maps.samples import load_sample
from robocorba.simulation.building import SimulatedBuilding, SimulationEvent
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.physics import STEP_S, FloorPhysics
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import area_request
from robocorba.simulation.world_record import WorldRecord
from robocorba.spatial.elevator_state import Doors
from robocorba.spatial.pose import Pose
from tests.simulation.places import robot, tower


@pytest.fixture
def world() -> SimulatedBuilding:
    return SimulatedBuilding(tower())


def enter(world: SimulatedBuilding, name: str, floor: str, x: float, y: float, heading: float = 0.0) -> None:
    world.add(Description(name, Pose(floor, x, y, heading)))


def run(world: SimulatedBuilding, seconds: float) -> list[SimulationEvent]:
    return [event for _ in range(round(seconds / STEP_S)) for event in world.step()]


@pytest.mark.parametrize(
    ("x", "y", "blocker"),
    [(3.2, 1.0, ""), (0.2, 5.0, ""), (2.0, 2.2, "T1"), (8.0, 7.5, ""), (7.5, 2.0, "A"), (4.2, 5.0, "")],
)
def test_a_robot_needs_room(world: SimulatedBuilding, x: float, y: float, blocker: str) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    with pytest.raises(PlaceTaken) as refused:
        enter(world, "B", "L1", x, y)
    assert refused.value.blocker == blocker
    assert list(world.occupants.robots) == ["A"]
    with pytest.raises(UnknownFloor):
        enter(world, "B", "roof", 7.0, 2.0)
    enter(world, "B", "L2", 7.0, 2.0)


def test_a_command_that_is_not_renewed_ends(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 5.0, 2.0)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 0.6)
    run(world, 1.5)
    x = world.occupants.pose("A").x
    assert 5.1 < x < 5.6
    run(world, 1.0)
    assert world.occupants.pose("A").x == pytest.approx(x, abs=0.01)
    for wrong in ((math.nan, 0.0, 0.0, 1.0), (0.0, math.inf, 0.0, 1.0), (0.0, 0.0, 0.0, 5.1), (0.0, 0.0, 0.0, -0.1)):
        with pytest.raises(InvalidCommand):
            world.occupants.robots["A"].command(*wrong)


def test_a_collision_is_reported(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 4.0, 1.0, math.pi)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    collisions = [event for event in run(world, 3.0) if event.kind == "collision"]
    assert [(event.floor, event.who) for event in collisions] == [("L1", ("A",))]


def test_closed_landing_doors_stop_a_robot(world: SimulatedBuilding) -> None:
    enter(world, "A", "L2", 5.0, 2.5, math.pi / 2)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(world, 6.0)
    assert world.occupants.pose("A").y == pytest.approx(3.6, abs=0.02)


def test_a_ride_to_another_floor(world: SimulatedBuilding) -> None:
    enter(world, "A", "L2", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L1")
    ride = world.elevators.cabins["E1"].sessions["A"]
    while ride.phase is RidePhase.WAITING:
        world.step()
    while ride.phase is RidePhase.BOARDING:
        world.occupants.robots["A"].command(0.5, 0.0, 0.0, 0.2)
        world.step()
    while ride.phase is RidePhase.RIDING:
        world.occupants.robots["A"].command(max(0.0, 5.0 - world.occupants.pose("A").y), 0.0, 0.0, 0.2)
        world.step()
    assert world.occupants.pose("A").floor == "L1"
    while "A" in world.elevators.cabins["E1"].sessions:
        world.occupants.robots["A"].command(-0.5, 0.0, 0.0, 0.2)
        world.step()
    assert world.occupants.pose("A")[:2] == ("L1", pytest.approx(5.0, abs=0.01))
    assert world.occupants.pose("A").y < 3.61
    assert "robot/A" not in world.occupants.floors["L2"].state()
    with pytest.raises(InvalidRide):
        world.elevators.call("A", "E9", "L2")


def into_the_cabin(world: SimulatedBuilding, name: str, y: float) -> None:
    """Drive a robot that faces the doors of E1 straight in."""
    while world.elevators.rides[name].phase is RidePhase.WAITING:
        world.step()
    while world.occupants.pose(name).y < y - 0.05:
        world.occupants.robots[name].command(max(0.1, min(0.5, y - world.occupants.pose(name).y)), 0.0, 0.0, 0.2)
        world.step()
    world.occupants.robots[name].brake()


def test_a_party_rides_alone(world: SimulatedBuilding) -> None:
    for name, y in (("A", 3.0), ("B", 2.0), ("X", 1.0)):
        enter(world, name, "L1", 5.0, y, math.pi / 2)
    for name in "AB":
        world.elevators.call(name, "E1", "L2", "table", 2)
    world.elevators.call("X", "E1", "L2")
    into_the_cabin(world, "A", 5.55)
    assert [world.elevators.rides[name].phase for name in "ABX"] == [
        RidePhase.RIDING,
        RidePhase.BOARDING,
        RidePhase.WAITING,
    ]
    into_the_cabin(world, "B", 4.5)
    while world.occupants.pose("A").floor == "L1":
        world.step()
    assert (world.occupants.pose("B").floor, world.occupants.pose("X").floor) == ("L2", "L1")


def test_a_party_does_not_board_while_another_robot_is_in_the_cabin(world: SimulatedBuilding) -> None:
    enter(world, "X", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("X", "E1", "L2")
    into_the_cabin(world, "X", 5.55)
    world.elevators.cancel("X")  # and it stays where it is
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2", "table", 1)
    into_the_cabin(world, "A", 4.5)
    run(world, 1.0)
    assert (world.elevators.rides["A"].phase, world.occupants.pose("A").y > 4.41) == (RidePhase.BOARDING, True)
    world.remove("X")
    world.step()
    assert world.elevators.rides["A"].phase is RidePhase.RIDING


def test_boarding_is_an_event_with_the_wait_that_was_announced(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 9.0)
    enter(world, "B", "L1", 3.0, 9.0)
    world.elevators.call("A", "E1", "L2")
    announced_s = world.elevators.longest_wait_s("A")
    events = run(world, 0.5)
    world.elevators.call("B", "E1", "L2")
    found = [event for event in [*events, *run(world, 60.0)] if event.kind == "boarding"]
    assert [(event.floor, event.who) for event in found] == [("L1", ("A",)), ("L1", ("B",))]
    assert found[0].longest_wait_s == announced_s
    for event in found:
        assert event.waited_s is not None and event.longest_wait_s is not None
        assert 0.0 < event.waited_s <= event.longest_wait_s


def test_waits_are_bounded_again_after_a_restart(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 9.0)
    world.elevators.call("A", "E1", "L2")
    run(world, 0.5)
    again = SimulatedBuilding(tower())
    again.restore(world.record(), [robot.description for robot in world.occupants.robots.values()])
    (event,) = [event for event in run(again, 60.0) if event.kind == "boarding"]
    assert event.waited_s is not None and event.longest_wait_s is not None
    assert 0.5 < event.waited_s <= event.longest_wait_s


def test_the_areas_of_a_silent_robot_with_an_object_are_kept(world: SimulatedBuilding) -> None:
    passage = area_request([("L1", ((0, 0), (1, 0), (1, 1)))], 60.0, world.occupants.floors)
    for name, x in (("A", 1.0), ("B", 5.0), ("C", 7.0)):
        enter(world, name, "L1", x, 2.0)
        world.reserve(name, [passage])
    world.occupants.grip("A", "T1", (1.6, 2.0))
    for name in "AB":
        world.fall_silent(name)
        world.remove(name)
    assert [kept.robot for kept in world.reservations.all(world.time)] == ["C", "A"]
    assert world.reservations.find("C", world.time) == (False, 1, 20.0, 60.0)
    (event,) = [event for event in run(world, 21.0) if event.kind == "reservation over"]
    assert (event.who, event.reason) == (("A",), "the robot fell silent")
    found = world.reservations.find("C", world.time)
    assert found and found.granted


def test_areas_of_removed_robots_and_expired_grants_are_free(world: SimulatedBuilding) -> None:
    for number, name in enumerate("ABC"):
        enter(world, name, "L1", 1.0 + 2 * number, 9.0)
        passage = area_request([("L1", ((0, 0), (1, 0), (1, 1)))], 1.0, world.occupants.floors)
        world.reserve(name, [passage])
    world.remove("A")
    assert world.reservations.find("B", world.time) == (True, 0, 0.0, 1.0)
    record = msgspec.msgpack.decode(msgspec.msgpack.encode(world.record()), type=WorldRecord)
    again = SimulatedBuilding(tower())
    again.restore(record, [about.description for about in world.occupants.robots.values()])
    assert again.reservations.record() == world.reservations.record()
    events = run(again, 1.1)
    assert [(event.kind, event.who, event.floor) for event in events] == [("reservation over", ("B",), "L1")]
    assert again.reservations.find("C", again.time) == (True, 0, 0.0, pytest.approx(0.9))


def test_a_robot_that_was_removed_blocks_no_elevator(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    enter(world, "B", "L2", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2")
    run(world, 2.0)
    assert world.elevators.cabins["E1"].sessions["A"].phase is RidePhase.BOARDING
    world.remove("A")
    world.elevators.call("B", "E1", "L1")
    for _ in range(round(30 / STEP_S)):
        world.step()
        if world.elevators.cabins["E1"].sessions["B"].phase is RidePhase.BOARDING:
            break
    else:
        pytest.fail("B was never let in")


def between_the_doors(world: SimulatedBuilding) -> None:
    """Robot A stops where the doors of E1 on L1 close."""
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2")
    into_the_cabin(world, "A", 4.05)
    run(world, 1.0)
    assert world.occupants.pose("A").y == pytest.approx(4.0, abs=0.2)


def test_doors_never_close_on_a_robot(world: SimulatedBuilding) -> None:
    between_the_doors(world)
    enter(world, "B", "L2", 5.0, 3.0, math.pi / 2)
    world.elevators.call("B", "E1", "L1")
    events = run(world, 60.0)
    assert [(event.kind, event.who) for event in events] == [("ride lost", ("A",))]
    assert world.elevators.cabins["E1"].doors is Doors.OPEN
    assert world.occupants.robots["A"].collisions == 0
    while world.occupants.pose("A").y > 3.0:
        world.occupants.robots["A"].command(-0.5, 0.0, 0.0, 0.2)
        world.step()
    assert "boarding" in [event.kind for event in run(world, 20.0)]


def with_a_box(at: tuple[float, float]) -> SimulatedBuilding:
    """The tower with a movable box of 0.6 m by 0.4 m on L2; the doors of E1 close at y = 4."""
    return SimulatedBuilding(tower().with_element("L2", MapObject("box", BoxShape((0.6, 0.4)), at, movable=True)))


def test_doors_with_something_between_them_on_the_map_begin_open() -> None:
    world = with_a_box((5.0, 4.0))
    run(world, 5.0)
    assert (world.elevators.cabins["E1"].floor, world.elevators.cabins["E1"].doors) == ("L2", Doors.OPEN)
    assert world.occupants.floors["L2"].pose("object/box") == pytest.approx((5.0, 4.0, 0.0), abs=1e-9)
    enter(world, "A", "L1", 5.0, 2.5, math.pi / 2)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(world, 6.0)
    assert world.occupants.pose("A").y == pytest.approx(3.6, abs=0.02)  # closed on the other floor


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
    assert (again.elevators.cabins["E1"].floor, again.elevators.cabins["E1"].doors) == ("L2", Doors.CLOSED)
    again.place("box", Pose("L2", 2.0, 8.0, 0.0))
    enter(again, "A", "L2", 5.0, 2.5, math.pi / 2)
    again.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(again, 6.0)
    assert again.occupants.pose("A").y == pytest.approx(3.6, abs=0.02)


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
        world.occupants.floors["L2"].pose("object/box")[1] - 0.2,
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
    while world.elevators.rides["A"].phase is not RidePhase.RIDING:
        world.step()
    world.place("box", Pose("L1", 5.0, 5.5, 0.0))
    world.occupants.grip("A", "box", (5.0, 5.3))
    while world.elevators.states["E1"].floor:
        world.step()
    enter(world, "B", "L1", 5.0, 2.0)
    world.elevators.call("B", "E1", "L2")
    world.occupants.release("A")
    world.elevators.cancel("A")
    run(world, 60.0)
    assert (world.elevators.cabins["E1"].floor, world.elevators.cabins["E1"].doors) == ("L2", Doors.OPEN)
    world.occupants.grip("A", "box", (5.0, 5.3))  # and may be carried out
    run(world, 30.0)
    assert (world.elevators.cabins["E1"].floor, world.elevators.cabins["E1"].doors) == ("L2", Doors.OPEN)
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


def test_an_object_in_the_cabin_on_the_map_begins_with_open_doors() -> None:
    world = with_a_box((5.0, 5.5))
    run(world, 5.0)
    assert (world.elevators.cabins["E1"].floor, world.elevators.cabins["E1"].doors) == ("L2", Doors.OPEN)


def test_doors_that_a_restart_finds_a_robot_between_are_open(world: SimulatedBuilding) -> None:
    between_the_doors(world)
    again = SimulatedBuilding(tower())
    again.restore(world.record(), [about.description for about in world.occupants.robots.values()])
    before = again.occupants.pose("A")
    assert again.elevators.cabins["E1"].doors is Doors.OPEN
    assert [event.kind for event in run(again, 1.0)] == ["boarding"]
    assert again.occupants.pose("A") == pytest.approx(before, abs=1e-9)
    assert again.elevators.rides["A"].phase is RidePhase.BOARDING
    into_the_cabin(again, "A", 5.0)
    while again.occupants.pose("A").floor == "L1":
        again.step()
    assert again.occupants.robots["A"].collisions == 0


def test_riders_keep_their_grips_on_the_other_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    building = tower()
    table = MapObject("T2", BoxShape((0.4, 0.4)), (2.0, 2.0), movable=True)
    world = SimulatedBuilding(building.with_element("L1", table))
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2")
    while world.elevators.rides["A"].phase is not RidePhase.RIDING:
        world.occupants.robots["A"].command(max(0.0, min(0.5, 4.75 - world.occupants.pose("A").y)), 0.0, 0.0, 0.2)
        world.step()
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
    while world.occupants.pose("A").floor == "L1":
        world.step()
    world.step()
    assert world.occupants.robots["A"].holding == "T2"
    assert set(seen) == {"T2"}
    assert world.occupants.objects["T2"][1] == "L2"


def test_a_robot_has_left_the_cabin_once_what_it_holds_has() -> None:
    table = MapObject("T2", BoxShape((0.4, 0.4)), (2.0, 2.0), movable=True)
    world = SimulatedBuilding(tower().with_element("L1", table))
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    world.elevators.call("A", "E1", "L2")
    while world.elevators.rides["A"].phase is not RidePhase.RIDING:
        world.occupants.robots["A"].command(max(0.0, min(0.5, 4.75 - world.occupants.pose("A").y)), 0.0, 0.0, 0.2)
        world.step()
    world.place("T2", Pose("L1", 5.0, 5.5, 0.0))
    world.occupants.grip("A", "T2", (5.0, 5.3))
    while world.elevators.rides["A"].phase is not RidePhase.ALIGHTING:
        world.step()
    with_object_in_doors = 0
    while "A" in world.elevators.rides:
        assert world.elevators.cabins["E1"].doors is Doors.OPEN
        world.occupants.robots["A"].command(-0.3, 0.0, 0.0, 0.2)
        world.step()
        with_object_in_doors += world.occupants.pose("A").y < 4.0 - 0.5
    assert with_object_in_doors > 10
    assert world.occupants.robots["A"].holding == "T2"
    assert world.occupants.robots["A"].physics.pose("object/T2")[1] < 4.0 - 0.2


def test_what_can_be_gripped(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 2.0)
    for name, at in (("T9", (1.5, 2.0)), ("T1", (2.5, 2.0)), ("T1", (1.1, 2.0)), ("T1", (math.nan, 2.0))):
        with pytest.raises(CannotGrip):
            world.occupants.grip("A", name, at)
    assert world.occupants.robots["A"].holding == ""
    world.occupants.grip("A", "T1", (1.6, 2.0))
    assert world.occupants.robots["A"].holding == "T1"
    world.occupants.release("A")
    world.occupants.release("A")
    assert world.occupants.robots["A"].holding == ""


def test_an_edit_of_the_map_is_followed(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 5.0, 2.0, 0.0)
    enter(world, "B", "L2", 5.0, 2.0, 0.0)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(world, 0.5)
    before = world.occupants.objects["T1"]
    edited = world.building.with_element("L1", Wall("W2", (6.5, 0.0), (6.5, 4.0)))
    assert world.update(edited) == []
    run(world, 4.0)
    assert world.occupants.pose("A").x == pytest.approx(6.1, abs=0.02)
    assert world.occupants.objects["T1"] == before
    assert world.update(edited.without(ElementKind.FLOOR, "", "L2").without(ElementKind.ELEVATOR, "", "E1")) == ["B"]
    assert not world.elevators.cabins and list(world.occupants.floors) == ["L1"]
    world.occupants.robots["A"].command(-0.5, 0.0, 0.0, 5.0)
    run(world, 1.0)
    assert world.occupants.pose("A").x < 6.0


def test_the_shaft_of_an_elevator_blocks_no_floor_above_it(world: SimulatedBuilding) -> None:
    world.update(world.building.with_element("", Floor("L3", 3, 8.0)))
    enter(world, "A", "L3", 4.0, 5.0)
    world.remove("A")
    world.update(world.building.with_changes([(ElementKind.FLOOR, "", "L2", Floor("L2", 4, 12.0))]))
    with pytest.raises(PlaceTaken):
        enter(world, "A", "L3", 4.0, 5.0)


def test_an_object_that_was_moved_stays_there_until_the_map_moves_it(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 2.0)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 3.0)
    run(world, 3.0)
    pushed = world.record().objects["T1"]
    assert pushed[1] > 2.1
    world.update(world.building.with_element("L1", Wall("W2", (9.0, 0.0), (9.0, 1.0))))
    assert world.record().objects["T1"] == pushed
    moved = MapObject("T1", BoxShape((1.0, 0.6)), (2.0, 8.0), movable=True)
    world.update(world.building.with_element("L1", moved))
    assert world.record().objects["T1"] == ("L1", 2.0, 8.0, 0.0)


def test_a_prepared_edit_leaves_little_to_do(world: SimulatedBuilding) -> None:
    run(world, 1.0)
    edited = world.building.with_element("", Floor("L3", 3, 8.0)).with_element("L3", Wall("W", (0.0, 0.0), (9.0, 0.0)))
    edited = edited.with_element("L1", Wall("W2", (9.0, 0.0), (9.0, 1.0)))
    for prepare in world.preparations(edited):
        prepare()
        run(world, STEP_S)
    assert world.occupants.floors["L1"].touching(9.0, 0.5, 0.1) == ""
    assert "L3" not in world.occupants.floors
    world.update(edited)
    assert world.occupants.floors["L3"].touching(5.0, 0.0, 0.1) == ""
    assert {floor.snapshot.time for floor in world.occupants.floors.values()} == {world.time}
    other = world.building.without(ElementKind.WALL, "L3", "W")
    list(world.preparations(edited))
    world.update(other)  # not the one that was prepared
    assert world.occupants.floors["L3"].touching(5.0, 0.0, 0.1) is None


def test_objects_of_one_name_on_two_floors_are_two() -> None:
    table = MapObject("T1", BoxShape((0.4, 0.4)), (2.0, 8.0), movable=True)
    world = SimulatedBuilding(tower().with_element("L2", table))
    assert set(world.occupants.objects) == {"L1/T1", "L2/T1"}
    run(world, 0.1)


def test_a_record_restores_robots_grips_and_rides(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 2.0)
    enter(world, "B", "L1", 5.0, 3.0, math.pi / 2)
    enter(world, "C", "L2", 5.0, 3.0, math.pi / 2)
    world.occupants.grip("A", "T1", (1.6, 2.0))
    world.occupants.robots["A"].command(0.0, 0.3, 0.0, 2.0)
    world.elevators.call("B", "E1", "L2")
    while world.elevators.rides["B"].phase is not RidePhase.RIDING:
        world.occupants.robots["B"].command(max(0.0, min(0.5, 5.0 - world.occupants.pose("B").y)), 0.0, 0.0, 0.2)
        world.step()
    world.elevators.call("C", "E1", "L1")
    record = msgspec.msgpack.decode(msgspec.msgpack.encode(world.record()), type=WorldRecord)
    again = SimulatedBuilding(tower())
    again.restore(
        record, [about.description for about in world.occupants.robots.values()] + [robot("D", "L1", 9.0, 1.0)]
    )
    assert again.time == world.time
    for name in "ABC":
        assert again.occupants.pose(name) == pytest.approx(world.occupants.pose(name), abs=1e-9)
        assert again.occupants.robots[name].state().velocity == (0.0, 0.0, 0.0)
    assert again.occupants.pose("D") == Pose("L1", 9.0, 1.0, 0.0)
    assert again.occupants.robots["A"].holding == "T1"
    assert again.record().objects == world.record().objects
    for _ in range(round(60 / STEP_S)):
        again.step()
        if again.elevators.rides["B"].phase is RidePhase.ALIGHTING:
            break
    assert again.occupants.pose("B").floor == "L2"
    assert again.elevators.rides["C"].phase is RidePhase.WAITING


def test_the_sample_runs() -> None:
    world = SimulatedBuilding(load_sample("five-floors"))
    run(world, 0.2)
    assert world.occupants.objects
    assert set(world.elevators.cabins) == set(world.building.elevators)


def test_a_robot_is_placed_at_rest_on_any_floor(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(world, 1.0)
    for pose in (Pose("L1", 1.0, 8.0, 1.0), Pose("L2", 2.0, 2.0, -2.0), Pose("L2", 2.1, 2.0, 0.0)):
        events = world.place("A", pose)
        assert [(event.kind, event.floor, event.who) for event in events] == [("placed", pose.floor, ("A",))]
        assert world.occupants.pose("A") == pytest.approx(pose)
        assert world.occupants.robots["A"].state().pose == pytest.approx(pose)  # also while time is paused
        run(world, 0.5)
        assert world.occupants.pose("A") == pytest.approx(pose)
    assert world.occupants.robots["A"].state().velocity == (0.0, 0.0, 0.0)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    run(world, 1.0)
    assert world.occupants.pose("A").x > 2.3


def test_an_object_is_placed_and_those_who_held_it_learn_so(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 2.0)
    enter(world, "B", "L1", 7.0, 8.5)
    world.occupants.grip("A", "T1", (1.5, 2.0))
    events = world.place("T1", Pose("L2", 2.0, 7.0, 1.0))
    assert [(event.kind, event.who) for event in events] == [("grip lost", ("A",)), ("placed", ("T1",))]
    assert world.occupants.robots["A"].holding == ""
    assert world.occupants.objects["T1"][1] == "L2"
    assert world.occupants.floors["L2"].pose("object/T1") == pytest.approx((2.0, 7.0, 1.0))
    world.place("T1", Pose("L1", 2.0, 2.0, 0.3))
    world.occupants.grip("A", "T1", (1.5, 2.0))
    events = world.place("A", Pose("L1", 7.0, 2.0, 0.0))
    assert [(event.kind, event.who) for event in events] == [("grip lost", ("A",)), ("placed", ("A",))]
    assert world.occupants.floors["L1"].pose("object/T1") == pytest.approx((2.0, 2.0, 0.3))


@pytest.mark.parametrize(
    ("body", "x", "y", "blocker"),
    [
        *(("A", 3.2, 1.0, ""), ("A", 2.0, 2.2, "T1"), ("A", 8.0, 7.5, ""), ("A", 7.4, 5.1, "B")),
        *(("T1", 3.2, 1.0, ""), ("T1", 7.2, 2.2, "A"), ("T1", 8.2, 8.0, ""), ("T1", 5.0, 4.1, "")),
    ],
)
def test_nothing_is_placed_where_something_is(
    world: SimulatedBuilding, body: str, x: float, y: float, blocker: str
) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    enter(world, "B", "L1", 7.5, 5.0)
    before = world.record()
    with pytest.raises(PlaceTaken) as refused:
        world.place(body, Pose("L1", x, y, 0.0))
    assert (refused.value.floor, refused.value.blocker) == ("L1", blocker)
    assert world.record() == before


def test_a_body_may_be_placed_over_its_own_place(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    world.place("A", Pose("L1", 7.1, 2.0, 0.0))
    world.place("T1", Pose("L1", 2.1, 2.0, 0.0))
    assert world.occupants.floors["L1"].pose("object/T1") == pytest.approx((2.1, 2.0, 0.0))


def test_an_impossible_placing_is_refused(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    before = world.record()
    for name in ("S1", "B", "", "x" * 1000):  # S1 does not move
        with pytest.raises(UnknownBody):
            world.place(name, Pose("L1", 5.0, 2.0, 0.0))
    with pytest.raises(UnknownFloor):
        world.place("A", Pose("roof", 5.0, 2.0, 0.0))
    for field, pose in (
        ("at.x", Pose("L1", math.nan, 2.0, 0.0)),
        ("at.y", Pose("L1", 5.0, -math.inf, 0.0)),
        ("at.heading", Pose("L1", 5.0, 2.0, 1e9)),
    ):
        with pytest.raises(InvalidChoice) as refused:
            world.place("A", pose)
        assert refused.value.field == field
    assert world.record() == before


def test_a_placed_robot_keeps_its_ride_and_its_reservation(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    world.elevators.call("A", "E1", "L2")
    square = ((0.0, 8.0), (1.0, 8.0), (1.0, 9.0))
    world.reserve("A", [area_request([("L1", square)], 60.0, world.occupants.floors)])
    world.place("A", Pose("L1", 1.0, 5.0, 0.0))
    assert "A" in world.elevators.rides
    (kept,) = world.reservations.all(world.time)
    assert (kept.robot, kept.areas, kept.status.granted) == ("A", (("L1", square),), True)


def test_a_posture_is_checked(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    robot = world.occupants.robots["A"]
    assert robot.posture is None
    run(world, 1.0)
    robot.report_posture([0.5] * 64)
    for joints in ([0.0] * 65, [math.nan], [0.0, math.inf]):
        with pytest.raises(InvalidCommand):
            robot.report_posture(joints)
    assert robot.posture == ("A", pytest.approx(1.0), (0.5,) * 64)
