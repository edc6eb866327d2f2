"""The simulated building: robots, velocity commands, grips, edits of the map, records, placing."""

from __future__ import annotations

import math

import msgspec
import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import CannotGrip, InvalidChoice, InvalidCommand, PlaceTaken, UnknownBody
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.world_record import WorldRecord
from tests.simulation.places import enter, robot, run, tower


@pytest.fixture
def world() -> SimulatedBuilding:
    return SimulatedBuilding(tower())


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


def test_what_can_be_gripped(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 2.0)
    for name, at in (("T9", (1.5, 2.0)), ("T1", (2.5, 2.0)), ("T1", (1.1, 2.0)), ("T1", (math.nan, 2.0))):
        with pytest.raises(CannotGrip):
            world.occupants.grip("A", name, at)
    assert world.occupants.robots["A"].holding == ""


def test_a_defect_on_one_floor_stops_no_other(world: SimulatedBuilding, monkeypatch: pytest.MonkeyPatch) -> None:
    enter(world, "A", "L2", 5.0, 2.0)

    def fail() -> None:
        raise ValueError("a defect")

    monkeypatch.setattr(world.occupants.floors["L1"], "step", fail)
    world.occupants.robots["A"].command(0.5, 0.0, 0.0, 5.0)
    for _ in range(50):
        with pytest.raises(ValueError, match="a defect"):
            world.step()
    assert world.occupants.pose("A").x > 5.1


def test_objects_of_one_name_on_two_floors_are_two() -> None:
    table = MapObject("T1", BoxShape((0.4, 0.4)), (2.0, 8.0), movable=True)
    world = SimulatedBuilding(tower().with_element("L2", table))
    assert set(world.occupants.objects) == {"L1/T1", "L2/T1"}
    with pytest.raises(InvalidChoice, match=r"'T1': write L1/T1 or L2/T1"):
        world.place("T1", Pose("L1", 6.0, 2.0))
    world.place("L2/T1", Pose("L1", 2.0, 2.9))
    enter(world, "A", "L1", 1.0, 2.0)
    with pytest.raises(CannotGrip, match=r"'T1': write L1/T1 or L2/T1"):
        world.occupants.grip("A", "T1", (1.6, 2.0))
    world.place("L2/T1", Pose("L2", 2.0, 8.0))
    world.occupants.grip("A", "T1", (1.6, 2.0))  # there is only one on its floor
    assert world.occupants.robots["A"].holding == "L1/T1"


def test_a_record_restores_robots_at_rest_and_moved_objects(world: SimulatedBuilding) -> None:
    enter(world, "A", "L1", 1.0, 2.0)
    world.occupants.grip("A", "T1", (1.6, 2.0))
    world.occupants.robots["A"].command(0.0, 0.3, 0.0, 2.0)
    run(world, 1.0)
    record = msgspec.msgpack.decode(msgspec.msgpack.encode(world.record()), type=WorldRecord)
    again = SimulatedBuilding(tower())
    again.restore(record, [robot("A", "L1", 1.0, 2.0), robot("D", "L1", 9.0, 1.0)])
    assert (again.time, again.record().objects) == (world.time, world.record().objects)
    assert again.occupants.robots["A"].state().velocity == (0.0, 0.0, 0.0)
    assert again.occupants.pose("D") == Pose("L1", 9.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("body", "x", "y", "blocker"),
    [
        *(("A", 3.2, 1.0, ""), ("A", 2.0, 2.2, "T1"), ("A", 8.0, 7.5, ""), ("A", 7.4, 5.1, "B")),
        *(("T1", 3.2, 1.0, ""), ("T1", 7.2, 2.2, "A"), ("T1", 8.2, 8.0, ""), ("T1", 5.0, 4.1, "")),
        *(("new", 3.2, 1.0, ""), ("new", 0.2, 5.0, ""), ("new", 2.0, 2.2, "T1"), ("new", 7.5, 2.0, "A")),
    ],
)
def test_nothing_comes_to_where_something_is(
    world: SimulatedBuilding, body: str, x: float, y: float, blocker: str
) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    enter(world, "B", "L1", 7.5, 5.0)
    before = world.record()
    with pytest.raises(PlaceTaken) as refused:
        if body == "new":
            enter(world, body, "L1", x, y)
        else:
            world.place(body, Pose("L1", x, y, 0.0))
    assert (refused.value.floor, refused.value.blocker) == ("L1", blocker)
    assert world.record() == before


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (Pose("L1", -5.0, 2.0), "outside of the outline of L1"),
        (Pose("L2", 30.0, 30.0), "outside of the outline of L2"),
        (Pose("L2", 5.0, 5.0), "in the shaft of E1, whose cabin is on L1"),
        (Pose("roof", 5.0, 2.0), "roof"),
        (Pose("L1", math.nan, 2.0), "at.x"),
        (Pose("L1", 5.0, -math.inf), "at.y"),
        (Pose("L1", 5.0, 2.0, 1e9), "at.heading"),
    ],
)
def test_nothing_comes_to_where_nothing_can_get(world: SimulatedBuilding, pose: Pose, reason: str) -> None:
    enter(world, "A", "L1", 7.0, 2.0)
    before = world.record()
    if not reason.startswith("at."):
        with pytest.raises((PlaceTaken, UnknownFloor), match=reason):
            enter(world, "B", *pose[:3])
    for body in ("A", "T1"):
        with pytest.raises((PlaceTaken, UnknownFloor, InvalidChoice), match=reason):
            world.place(body, pose)
    for name in ("S1", "B", "", "x" * 1000):  # S1 does not move
        with pytest.raises(UnknownBody):
            world.place(name, Pose("L1", 5.0, 2.0, 0.0))
    assert world.record() == before
    enter(world, "C", "L1", 5.0, 5.0)  # in the cabin


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
