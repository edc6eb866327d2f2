"""How robots carry an object together: their path, or what blocks it."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from robocorba.errors.robots import ImpossibleCarry, InvalidPlan
from robocorba.map_editor.geometry import Obstacle, obstacles
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    CabinSide,
    Door,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    Wall,
)
from robocorba.map_editor.samples import load_sample
from robocorba.missions.carry_planning import CarryPlan, _FormationBody, plan_carries, warm_up
from robocorba.missions.formation import BACK_OFF_M, MARGIN_M
from robocorba.missions.obstacles import placed
from robocorba.missions.trajectory import Trajectory
from robocorba.robot.kinematics.smartpal import RADIUS_M

BOX = shapely.box(-0.3, -0.2, 0.3, 0.2)
TABLE = shapely.box(-0.8, -0.4, 0.8, 0.4)
Start = tuple[str, float, float, float]


@pytest.fixture(scope="module", autouse=True)
def kernels() -> None:
    warm_up()


def floor(name: str, width_m: float, depth_m: float, *things: Element, level: int = 1) -> Building:
    outline = ((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m))
    building = Building("test").with_element("", Floor(name=name, level=level, elevation=4.0 * level, outline=outline))
    for thing in things:
        building = building.with_element(name, thing)
    return building


def two_rooms(door_m: float, locked: bool = False) -> Building:
    return floor(
        "L1",
        12.0,
        7.0,
        Wall(name="between", a=(6.0, 0.0), b=(6.0, 7.0)),
        Door(name="narrow", a=(6.0, 3.5 - door_m / 2), b=(6.0, 3.5 + door_m / 2), locked=locked),
    )


def two_floors(cabin_m: float, door_m: float) -> Building:
    floors = {name: floor(name, 12.0, 8.0, level=level).floors[name] for level, name in enumerate(("L1", "L2"), 1)}
    doors = (ElevatorDoor("L1", width=door_m), ElevatorDoor("L2", width=door_m))
    elevator = Elevator(name="E1", at=(6.0, 6.0), size=(cabin_m, cabin_m), doors=doors)
    return Building("two floors", floors).with_element("", elevator)


def best_plan(*args: Any, **kwargs: Any) -> CarryPlan:
    """The first one of plan_carries."""
    return next(plan_carries(*args, **kwargs))


def check(building: Building, plan: CarryPlan, carried: str = "", blocked: tuple[Obstacle, ...] = ()) -> None:
    """The whole body is clear of all obstacles, all along its trajectories."""
    footprint = plan.footprint()
    places = plan.formation.carrier_poses()
    for leg in plan.legs:
        on_map = [item.geometry for item in obstacles(building, leg.floor) if item.name != carried]
        everything = shapely.union_all([*on_map, *(item.geometry for item in blocked)])
        shapely.prepare(everything)
        trajectory = Trajectory(leg.poses, places)
        for t in np.arange(0.0, trajectory.duration + 0.1, 0.1):
            body = placed(footprint, trajectory.at(t)[0])
            assert everything.distance(body) > MARGIN_M - 0.006, (leg.floor, t)
        for place in plan.formation.carrier_poses(plan.back_off_m):
            x, y, _ = trajectory.carrier(trajectory.duration, place)[0]
            assert leg.elevator_after or everything.distance(shapely.Point(x, y)) > RADIUS_M - 1e-6


def reached(pose: np.ndarray, goal: tuple[float, float, float]) -> bool:
    turned = math.remainder(pose[2] - goal[2], math.tau)
    return bool(np.abs([pose[0] - goal[0], pose[1] - goal[1], turned]).max() < 1e-9)


@st.composite
def rooms(draw: st.DrawFn) -> Building:
    things = []
    for i in range(draw(st.integers(0, 5))):
        size = draw(st.floats(0.2, 2.0)), draw(st.floats(0.2, 2.0))
        at = draw(st.floats(1.5, 7.5)), draw(st.floats(1.5, 5.5))
        things.append(MapObject(name=f"o{i}", shape=BoxShape(size=size), at=at, heading=draw(st.floats(-3, 3))))
    return floor("L1", 9.0, 7.0, *things)


places = st.tuples(st.just("L1"), st.floats(1.0, 8.0), st.floats(1.0, 6.0), st.floats(-4.0, 4.0))


@settings(max_examples=15, deadline=None)
@given(rooms(), places, places, st.integers(2, 3), st.sampled_from((BOX, TABLE)))
def test_carriers_and_object_touch_nothing(
    building: Building,
    start: tuple[str, float, float, float],
    goal: tuple[str, float, float, float],
    count: int,
    outline: Polygon,
) -> None:
    try:
        plan = best_plan(building, outline, start, goal, count)
    except ImpossibleCarry as impossible:
        assert impossible.blockers
        return
    assert tuple(plan.legs[0].poses[0]) == start[1:]
    assert reached(plan.legs[-1].poses[-1], goal[1:])
    check(building, plan)


def corridor(width_m: float) -> Building:
    """East, then north round the corner of a block."""
    inner = 9.0 - width_m
    return floor(
        "L1",
        9.0,
        9.0,
        Wall(name="corner-south", a=(0.0, width_m), b=(inner, width_m)),
        Wall(name="corner-east", a=(inner, width_m), b=(inner, 9.0)),
    )


def in_corridor(width_m: float) -> tuple[Building, Polygon, Start, Start, int]:
    """From the middle of its first part to the middle of its second one."""
    middle = width_m / 2
    return corridor(width_m), TABLE, ("L1", 3.0, middle, 0.0), ("L1", 9.0 - middle, 6.0, math.pi / 2), 2


def door_at_7m() -> Building:
    return floor("L1", 14.0, 7.0, Wall("wall", (7.0, 0.0), (7.0, 7.0)), Door("door", (7.0, 2.5), (7.0, 4.5)))


SCENE, CABIN = load_sample("paper-scene"), shapely.box(4.5, 4.5, 7.5, 7.5)


@pytest.mark.parametrize(
    ("building", "carried", "start", "goal", "count"),
    [
        *((SCENE, "table", None, ("L1", 6.7, 3.1, 0.4), count) for count in (2, 3, 4)),
        *((SCENE, "table", None, ("L1", *goal), 2) for goal in ((11.3, 3.1, math.pi / 2), (6.7, 7.75, 0.0))),
        (SCENE, "table", None, ("L1", 6.7, 7.75, math.pi), 2),
        in_corridor(2.6),
        (two_rooms(1.0), TABLE, ("L1", 3.0, 3.5, 0.0), ("L1", 9.0, 3.5, 0.0), 2),
        # What was put down at a door: the carriers have no room to approach from afar.
        (door_at_7m(), BOX, ("L1", 5.94, 3.52, math.pi / 4), ("L1", 10.5, 3.5, 0.0), 2),
        (two_floors(3.0, 2.0), BOX, ("L1", 2.5, 2.5, 1.0), ("L2", 9.0, 2.5, -2.0), 2),
        # Out of an elevator, as after the death of a carrier there: it keeps the doors open, between them or in it.
        *(
            (two_floors(3.0, 2.0), BOX, ("L1", 6.0, y, 0.0), goal, 2)
            for y in (4.5, 6.5)
            for goal in (("L1", 2.5, 2.5, 1.0), ("L2", 9.0, 2.5, -2.0))
        ),
    ],
)
def test_carriers_get_an_object_to_its_goal(
    building: Building, carried: Any, start: Any, goal: Start, count: int
) -> None:
    plan = best_plan(building, carried, start, goal, count)
    assert tuple(plan.legs[0].poses[0]) == ((2.8, 3.3, 0.0) if start is None else start[1:])
    assert reached(plan.legs[-1].poses[-1], goal[1:])
    assert plan.back_off_m < BACK_OFF_M or "door" not in building.floors["L1"].geometrical.doors
    check(building, plan, carried if start is None else "")
    assert [leg.elevator_after for leg in plan.legs] == (["E1", ""] if goal[0] == "L2" else [""])
    for before, after in pairwise(plan.legs):
        assert reached(before.poses[-1], tuple(after.poses[0]))
        assert CABIN.buffer(-MARGIN_M + 1e-6).covers(placed(plan.footprint(), tuple(before.poses[-1])))


WEST, EAST, UP = ("L1", 3.0, 3.5, 0.0), ("L1", 9.0, 3.5, 0.0), ("L2", 9.0, 2.5, 0.0)
#: A shaft across the whole corridor, with a door on each side.
DOORS = (ElevatorDoor("L1", side=CabinSide.LEFT, width=2.5), ElevatorDoor("L1", side=CabinSide.RIGHT, width=2.5))
SHAFT = floor("L1", 14.0, 4.0).with_element("", Elevator(name="E1", at=(7.0, 2.0), size=(4.0, 4.0), doors=DOORS))
SHELF = floor("L1", 9.0, 7.0, MapObject(name="shelf", shape=BoxShape(size=(2.0, 0.5)), at=(6.0, 4.2)))


@pytest.mark.parametrize(
    ("building", "carried", "start", "goal", "count", "message"),
    [
        (two_rooms(0.85), TABLE, WEST, EAST, 2, "; door 'narrow' on L1: .*0.85 m wide, 0.90 m needed"),
        (two_rooms(2.0, locked=True), TABLE, WEST, EAST, 2, "; door 'narrow' on L1: .*is locked"),
        (two_floors(2.0, 1.8), TABLE, WEST, UP, 2, "; elevator 'E1'.*: .*2.00 m by 2.00 m"),
        (two_floors(3.5, 0.7), BOX, WEST, UP, 2, "; elevator 'E1'.*: .*its door is 0.70 m wide"),
        (*in_corridor(1.5), r"; .*(L1|corner-south|corner-east).*: .*(to turn|for it) at L1 \("),
        (SHAFT, BOX, ("L1", 2.5, 2.0, 0.0), ("L1", 11.5, 2.0, 0.0), 2, "; "),
        # Nothing keeps the doors open at a goal between the doors, or in the cabin.
        *((two_floors(3.0, 2.0), BOX, WEST, ("L1", 6.0, y, 0.0), 2, "E1|separate") for y in (4.5, 6.5)),
        (Building("apart", two_floors(3.0, 2.0).floors), BOX, WEST, UP, 2, "no elevator leads from L1 to L2"),
        (SHELF, TABLE, ("L1", 2.5, 3.0, 0.0), ("L1", 6.0, 3.8, 0.0), 2, "goal.*; object 'shelf' on L1"),
        (SHELF, TABLE, ("L1", 0.5, 3.0, 0.0), ("L1", 6.0, 2.0, 0.0), 2, "start"),
    ],
)
def test_what_blocks_a_carry_is_named(
    building: Building, carried: Any, start: Any, goal: Any, count: int, message: str
) -> None:
    with pytest.raises(ImpossibleCarry, match=message) as raised:
        best_plan(building, carried, start, goal, count)
    assert len(raised.value.blockers) <= 1


def test_carriers_reach_and_leave_their_places_as_getpath_wants() -> None:
    """With all of their circles, not only with polygons in them."""
    formation = best_plan(floor("L1", 9.0, 7.0), TABLE, ("L1", 3.0, 3.0, 0.0), ("L1", 6.0, 3.0, 0.0), 2).formation
    body = _FormationBody(formation, TABLE)
    for (x, y, _), area in zip(formation.carrier_poses(BACK_OFF_M), body.approach_areas(BACK_OFF_M), strict=True):
        assert area.boundary.distance(shapely.Point(x, y)) >= RADIUS_M - 1e-12


def test_objects_and_robots_are_avoided_where_they_are_now() -> None:
    crate = MapObject(name="crate", shape=BoxShape(size=(1.0, 1.0)), at=(6.0, 3.5), movable=True)
    building = floor("L1", 12.0, 7.0, crate)
    start, goal = ("L1", 2.5, 3.5, 0.0), ("L1", 6.0, 3.5, 0.0)
    with pytest.raises(ImpossibleCarry, match="crate"):
        best_plan(building, TABLE, start, goal, 2)
    moved = Obstacle("object", "crate", shapely.box(8.5, 5.5, 9.5, 6.5))
    plan = best_plan(building, TABLE, start, goal, 2, blocked={"L1": [moved]})
    check(building, plan, "crate", (moved,))
    with pytest.raises(ImpossibleCarry):
        best_plan(building, TABLE, start, goal, 2, blocked={"L1": [moved, shapely.box(5.5, 3.0, 6.5, 4.0)]})
    building, robot = floor("L1", 12.0, 7.0), Obstacle("robot", "C", shapely.Point(6.0, 3.5).buffer(0.4))
    plan = best_plan(building, TABLE, start, ("L1", 9.5, 3.5, 0.0), 2, blocked={"L1": [robot]})
    assert len(plan.legs[0].poses) > 2
    check(building, plan, "", (robot,))


@pytest.mark.parametrize(
    ("thing", "start", "goal", "count"),
    [
        ("nothing", None, ("L1", 6.0, 3.0, 0.0), 2),
        ("table", None, ("L9", 6.0, 3.0, 0.0), 2),
        ("table", None, ("L1", math.nan, 3.0, 0.0), 2),
        ("table", ("L1", 1e9, 3.0, 0.0), ("L1", 6.0, 3.0, 0.0), 2),
        ("table", None, ("L1", 6.0, 3.0, 0.0), 0),
        (TABLE, None, ("L1", 6.0, 3.0, 0.0), 2),
    ],
)
def test_invalid_requests_are_refused(thing, start, goal, count) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidPlan):
        best_plan(SCENE, thing, start, goal, count)
