"""The simulated building: logging on, driving, commands that end, rides, what is moved along."""

from __future__ import annotations

import math

import pytest

from robocorba.errors import PlaceTaken, UnknownElement, UnknownFloor, UnknownRobot
from robocorba.maps.model import (
    BoxShape,
    Building,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    Wall,
)
from robocorba.maps.samples import load_sample
from robocorba.simulation.building import Happening, SimulatedBuilding
from robocorba.simulation.elevator import Phase
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.registry import Description, Pose


def tower() -> Building:
    """Two floors of 10 x 10 m, an elevator in the middle with its door to the front, a table and a shelf below."""
    lift = Elevator("E1", (5.0, 5.0), (2.0, 2.0), (ElevatorDoor("L1"), ElevatorDoor("L2")), speed=2.0, door_time=1.0)
    table = MapObject("T1", BoxShape((1.0, 0.6)), (2.0, 2.0), 0.3, movable=True)
    shelf = MapObject("S1", BoxShape((1.0, 0.6)), (8.0, 8.0))
    square = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    plan = GeometricalMap({"W1": Wall("W1", (3.0, 0.0), (3.0, 3.0))}, {"T1": table, "S1": shelf})
    floors = {
        "L1": FloorMap(Floor("L1", 1, 0.0, outline=square), plan),
        "L2": FloorMap(Floor("L2", 2, 4.0, outline=square)),
    }
    return Building("tower", floors, {"E1": lift})


@pytest.fixture
def world() -> SimulatedBuilding:
    return SimulatedBuilding(tower())


def enter(world: SimulatedBuilding, name: str, floor: str, x: float, y: float, heading: float = 0.0) -> None:
    world.add(Description(name, Pose(floor, x, y, heading)))


def run(world: SimulatedBuilding, seconds: float) -> list[Happening]:
    return [happening for _ in range(round(seconds / STEP_S)) for happening in world.step()]


@pytest.mark.parametrize(
    ("x", "y", "blocker"),
    [(3.2, 1.0, ""), (0.2, 5.0, ""), (2.0, 2.2, "object/T1"), (8.0, 7.5, ""), (7.5, 2.0, "robot/A"), (4.2, 5.0, "")],
)
def test_a_robot_needs_room(world: SimulatedBuilding, x: float, y: float, blocker: str) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    with pytest.raises(PlaceTaken) as refused:
        enter(world, "B", "L1", x, y)
    assert refused.value.blocker == blocker
    assert list(world.robots) == ["A"]
    with pytest.raises(UnknownFloor):
        enter(world, "B", "roof", 7.0, 2.0)
    enter(world, "B", "L2", 7.0, 2.0)


def test_a_command_that_is_not_renewed_ends(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 5.0, 2.0)
    world.command("A", (0.5, 0.0, 0.0), 0.6)
    run(world, 1.5)
    x = world.pose("A").x
    assert 5.1 < x < 5.6
    run(world, 1.0)
    assert world.pose("A").x == pytest.approx(x, abs=0.01)
    with pytest.raises(UnknownRobot):
        world.command("B", (0.5, 0.0, 0.0), 0.6)


def test_a_collision_is_told(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 4.0, 1.0, math.pi)
    world.command("A", (0.5, 0.0, 0.0), 5.0)
    told = [happening for happening in run(world, 3.0) if happening.kind == "collision"]
    assert [(happening.floor, happening.who) for happening in told] == [("L1", ("A",))]


def test_closed_landing_doors_stop_a_robot(world: SimulatedBuilding) -> None:
    enter(world, "A", "L2", 5.0, 2.5, math.pi / 2)
    world.command("A", (0.5, 0.0, 0.0), 10.0)
    run(world, 6.0)
    assert world.pose("A").y == pytest.approx(3.6, abs=0.02)


def test_a_ride_to_another_floor(world: SimulatedBuilding) -> None:
    enter(world, "A", "L2", 5.0, 3.0, math.pi / 2)
    world.call_elevator("A", "E1", "L1")
    ride = world.cabins["E1"].sessions["A"]
    while ride.phase is Phase.WAITING:
        world.step()
    while ride.phase is Phase.BOARDING:
        world.command("A", (0.5, 0.0, 0.0), 0.2)
        world.step()
    while ride.phase is Phase.RIDING:
        world.command("A", (max(0.0, 5.0 - world.pose("A").y), 0.0, 0.0), 0.2)
        world.step()
    assert world.pose("A").floor == "L1"
    while "A" in world.cabins["E1"].sessions:
        world.command("A", (-0.5, 0.0, 0.0), 0.2)
        world.step()
    assert world.pose("A")[:2] == ("L1", pytest.approx(5.0, abs=0.01))
    assert world.pose("A").y < 3.61
    assert "robot/A" not in world.floors["L2"].state()
    with pytest.raises(UnknownElement):
        world.call_elevator("A", "E9", "L2")


def test_a_robot_that_was_removed_blocks_no_elevator(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 5.0, 3.0, math.pi / 2)
    enter(world, "B", "L2", 5.0, 3.0, math.pi / 2)
    world.call_elevator("A", "E1", "L2")
    run(world, 2.0)
    assert world.cabins["E1"].sessions["A"].phase is Phase.BOARDING
    world.remove("A")
    world.call_elevator("B", "E1", "L1")
    for _ in range(round(30 / STEP_S)):
        world.step()
        if world.cabins["E1"].sessions["B"].phase is Phase.BOARDING:
            break
    else:
        pytest.fail("B was never let in")


def test_the_sample_runs() -> None:
    world = SimulatedBuilding(load_sample("five-floors"))
    run(world, 0.2)
    assert world.objects
    assert set(world.cabins) == set(world.building.elevators)
