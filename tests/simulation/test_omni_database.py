"""The Omni database, copies that follow it, and the last scans of robots."""

from __future__ import annotations

import math

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.model import BoxShape, ElementKind, MapObject
from robocorba.map_editor.spatial.elevator_state import Doors
from robocorba.map_editor.spatial.floor_update import WHOLE, BodyKind, FloorView
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.simulation.robot_scans import IDLE_INTERVAL_S, MAX_SENSORS, READ_INTERVAL_S, READ_WINDOW_S, RobotScans
from tests.clock import Clock
from tests.simulation.places import robot, run, scan, tower


def same(view: FloorView, world: SimulatedBuilding) -> bool:
    """Whether a copy equals the building."""
    state = world.occupants.floors[view.floor].state()
    bodies = {world.occupants.published[name].number: row for name, row in state.items()}
    assert set(view.bodies) == set(bodies)
    for number, row in bodies.items():
        motion = view.motion(number)
        assert (motion["x"], motion["y"]) == row[:2]
        assert math.remainder(motion["heading"] - row[2], math.tau) == pytest.approx(0.0, abs=1e-12)
        assert (motion["vx"], motion["vy"], motion["turn"]) == pytest.approx(row[3:], abs=1e-6)
    return True


def test_updates_hold_the_whole_floor_then_changes() -> None:
    world = SimulatedBuilding(tower())
    world.add(robot("A"))
    world.refresh()
    database, view = OmniDatabase(world), FloorView("L1")
    first = database.floor("L1")
    kinds = {body.name: body.kind for body in first.came}
    assert (first.since, kinds) == (WHOLE, {"A": BodyKind.ROBOT, "T1": BodyKind.OBJECT})
    view.apply(first)
    run(world, 0.1)
    nothing = database.changes("L1", view.version)
    assert (nothing.version, nothing.came, nothing.went, len(nothing.motions)) == (view.version, [], [], 0)
    world.occupants.robots["A"].command(0.5, 0.2, 0.1, 1.0)
    run(world, 0.5)
    moved = database.changes("L1", view.version)
    assert moved.motions["number"].tolist() == [world.occupants.robots["A"].number]
    assert len(moved.motions.tobytes()) == 40
    for since in (1, first.version + 1000):
        assert database.changes("L1", since).since == WHOLE, "an unknown version gets the whole floor"
    with pytest.raises(UnknownFloor):
        database.changes("roof", WHOLE)
    with pytest.raises(UpdateMismatch):
        view.apply(first._replace(since=5))
    world.update(tower().without(ElementKind.FLOOR, "", "L1").without(ElementKind.ELEVATOR, "", "E1"))
    assert not world.elevators.cabins
    with pytest.raises(UnknownFloor):
        database.floor("L1")
    world.update(tower())
    assert database.changes("L1", first.version).since == WHOLE, "another floor of the same name comes whole"


def test_a_renamed_object_is_the_same_body() -> None:
    world = SimulatedBuilding(tower())
    database, view = OmniDatabase(world), FloorView("L1")
    view.apply(database.floor("L1"))
    number = world.occupants.objects["T1"].number
    world.update(world.building.with_element("L2", MapObject("T1", BoxShape((0.4, 0.4)), (2.0, 8.0), movable=True)))
    update = database.changes("L1", view.version)
    assert [(body.number, body.name) for body in update.came] == [(number, "L1/T1")]
    assert update.went == []
    view.apply(update)
    assert same(view, world)


def test_updates_hold_changed_elevators() -> None:
    world = SimulatedBuilding(tower())
    world.add(robot("A", "L2", 5.0, 3.0))
    world.refresh()
    database, view = OmniDatabase(world), FloorView("L2")
    view.apply(database.floor("L2"))
    assert view.elevators["E1"].doors is Doors.CLOSED
    run(world, 0.1)
    assert database.changes("L2", view.version).elevators == {}
    world.elevators.call("A", "E1", "L1")
    run(world, 0.1)
    view.apply(database.changes("L2", view.version))
    assert view.elevators["E1"].queue == ("A",)
    run(world, 6.0)
    view.apply(database.changes("L2", view.version))
    assert (view.elevators["E1"].doors, view.elevators["E1"].floor) == (Doors.OPEN, "L2")
    assert database.elevators() == view.elevators


acts = st.sampled_from(["add", "remove", "drive", "run", "follow", "behind"])


@hypothesis.settings(max_examples=30, deadline=None)
@hypothesis.given(st.lists(st.tuples(acts, st.sampled_from("ABCD"), st.integers(0, 3)), max_size=40))
def test_copies_that_follow_equal_the_building(acts: list[tuple[str, str, int]]) -> None:
    world = SimulatedBuilding(tower())
    database = OmniDatabase(world)
    views = {"follow": FloorView("L1"), "behind": FloorView("L1")}
    for act, name, number in acts:
        if act == "add" and name not in world.occupants.robots:
            world.add(robot(name, "L1", 4.0 + 1.0 * "ABCD".index(name), 1.0))
        elif act == "remove" and name in world.occupants.robots:
            world.remove(name)
        elif act == "drive" and name in world.occupants.robots:
            world.occupants.robots[name].command(0.0, 0.3 * (number - 1), 0.5, 0.5)
        elif act == "run":
            run(world, 0.1 * number)
        elif act in views:
            views[act].apply(database.changes("L1", views[act].version))
        world.refresh()
    for view in views.values():
        view.apply(database.changes("L1", view.version))
        assert same(view, world)
        assert np.array_equal(view.motions["number"], list(view.bodies))


# ---- the last scan of each sensor of a robot ----


def test_each_sensor_has_its_last_scan() -> None:
    clock = Clock()
    scans = RobotScans(clock)
    assert scans.interval_s == IDLE_INTERVAL_S
    ring = {"distances": np.ones(8), "hits": np.ones(8, bool), "range_m": 1.0}
    for at_s in (1.0, 2.0):
        scans.record(scan(time=at_s))
        scans.record(scan(time=at_s, **ring))
        scans.record(scan(time=at_s, ahead=0.3))
    scans.record(scan("B", 2.5))
    assert [(one.robot, one.time, len(one.distances), one.mount[0]) for one in scans.since("L1", 0.0)] == [
        *(("A", 2.0, 5, 0.0), ("A", 2.0, 8, 0.0), ("A", 2.0, 5, 0.3), ("B", 2.5, 5, 0.0))
    ]
    assert scans.interval_s == READ_INTERVAL_S
    assert [one.robot for one in scans.since("L1", 2.0)] == ["B"]
    clock.now += READ_WINDOW_S + 0.1
    assert scans.interval_s == IDLE_INTERVAL_S


def test_scans_of_a_robot_are_of_its_floor_few_and_forgotten_when_it_leaves() -> None:
    scans = RobotScans(Clock())
    for number in range(3 * MAX_SENSORS):
        scans.record(scan(ahead=number / 100))
    kept = [one.mount[0] for one in scans.since("L1", 0.0)]
    assert kept == [number / 100 for number in range(2 * MAX_SENSORS, 3 * MAX_SENSORS)]
    for name in "BCD":
        scans.record(scan(name))
    scans.record(scan("D", time=2.0, floor="L2"))
    assert [one.robot for one in scans.since("L1", 0.0)] == ["A"] * MAX_SENSORS + ["B", "C"]
    assert [one.robot for one in scans.since("L2", 0.0)] == ["D"]
    scans.forget("A")
    scans.keep({"C", "D"})
    assert [one.robot for one in scans.since("L1", 0.0)] == ["C"]
