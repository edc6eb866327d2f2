"""The plans of move_table: which robot carries where, on one floor and through an elevator whose doors close."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import pytest
from msgspec import structs
from shapely import Point, Polygon
from shapely.affinity import rotate, translate

from robocorba.errors.robots import GoalReached, ImpossibleCarry, InTheWay, MissionFailed
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.model import CabinSide, Elevator, ElevatorDoor
from robocorba.map_editor.polygons import FloorArea
from robocorba.missions import move_table
from robocorba.missions.formation import BACK_OFF_M
from robocorba.missions.move_table import DOOR_MARGIN_S, SUCCESSION_S, MoveTablePlanner
from robocorba.missions.subplan import (
    Approach,
    CallCabin,
    Carry,
    CooperativePlan,
    Gather,
    Idle,
    PutDown,
    Reserve,
    Ride,
    Step,
    TakeHold,
    holding_steps,
)
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.world import StandingRobot
from robocorba.planning.request import Place
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.programs.icons import Destination
from robocorba.simulation.elevator import BOARDING_LIMIT_S
from testkit.buildings import two_storeys, with_all
from tests.missions.worlds import MapWorld, first_way

ROBOTS = {"A": Place("L1", 3.8, 1.8), "B": Place("L1", 3.8, 5.2), "C": Place("L2", 2.0, 2.0)}
GOAL = Destination("L2", 6.0, 3.5)


@pytest.fixture(scope="module")
def world() -> MapWorld:
    return MapWorld(two_storeys())


@pytest.fixture(scope="module")
def up(world: MapWorld) -> CooperativePlan:
    return MoveTablePlanner(world, "box", GOAL).plan("m", "A", ROBOTS)


def test_the_elevator_that_is_granted_the_soonest_is_taken() -> None:
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, 2.4) for floor in ("L1", "L2"))
    west = Elevator("W1", (1.5, 3.5), (3.0, 3.0), doors, heading=math.pi / 2, speed=1.0, door_time=2.0)
    world = MapWorld(with_all(two_storeys(), [("", west)]))
    asked: list[Sequence[Sequence[FloorArea]]] = []

    def other_way(alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
        asked.append(alternatives)
        return 1

    robots = {"A": Place("L1", 3.8, 1.8), "B": Place("L1", 6.5, 5.5)}
    for reserve, elevator in ((first_way, "W1"), (other_way, "E1")):
        planner = MoveTablePlanner(world, "box", GOAL)
        planner.reserve(reserve)
        plan = planner.plan("m", "A", robots)
        rides = {step.elevator for step in steps_of(plan, "A") if isinstance(step, Ride)}
        assert rides == {elevator}
    (reserve_step,) = [step for step in steps_of(plan, "A") if isinstance(step, Reserve)]
    assert [reserve_step.areas] == [areas for areas in asked[0] if areas != asked[0][0]]
    ends = [Polygon(areas[0][1]).bounds for areas in asked[0]]
    assert ends[0][0] < 3.0 and ends[1][2] > 8.0  # into the cabins


def steps_of(plan: CooperativePlan, robot: str) -> tuple[Step | Idle, ...]:
    return next(subplan.steps for subplan in plan.subplans if subplan.robot == robot)


def test_roles_and_first_steps(up: CooperativePlan) -> None:
    assert {subplan.robot: subplan.role for subplan in up.subplans} == {"A": "leader", "B": "helper"}
    assert len({len(subplan.steps) for subplan in up.subplans} | {len(up.phases)}) == 1
    for subplan in up.subplans:
        first, gather, approach, hold = subplan.steps[:4]
        assert isinstance(first, Reserve if subplan.robot == "A" else Idle)
        assert isinstance(gather, Gather) and isinstance(approach, Approach) and isinstance(hold, TakeHold)
        assert math.dist((gather.x, gather.y), (approach.x, approach.y)) == pytest.approx(BACK_OFF_M)
        faces = math.atan2(hold.y - approach.y, hold.x - approach.x)
        assert math.remainder(faces - approach.heading, math.tau) == pytest.approx(0.0, abs=1e-9)
        assert math.dist((hold.x, hold.y), (approach.x, approach.y)) > RADIUS_M
    a, b = (subplan.steps[1] for subplan in up.subplans)
    assert isinstance(a, Gather) and isinstance(b, Gather)
    assert up.subplans[0].robot == ("A" if a.y < b.y else "B")  # each from its own side


def test_the_leader_reserves_all_swept_areas(up: CooperativePlan) -> None:
    reserve = steps_of(up, "A")[0]
    assert isinstance(reserve, Reserve)
    assert [floor for floor, _ in reserve.areas] == ["L1", "L2"]
    here, there = (Polygon(corners) for _, corners in reserve.areas)
    for subplan in up.subplans:
        gather = subplan.steps[1]
        assert isinstance(gather, Gather)
        assert here.contains(Point(gather.x, gather.y))
    assert there.contains(Point(GOAL.x, GOAL.y))
    calls = [step for subplan in up.subplans for step in subplan.steps if isinstance(step, CallCabin)]
    assert {(call.party, call.size) for call in calls} == {("m to L2", 2)}


def test_each_carry_starts_where_the_one_before_ended(up: CooperativePlan) -> None:
    carries = [Trajectory.from_rows(step.rows) for step in steps_of(up, "A") if isinstance(step, Carry)]
    assert carries[0].start == pytest.approx((5.4, 3.5, -0.785))
    assert carries[-1].goal == pytest.approx((GOAL.x, GOAL.y, GOAL.heading))
    for before, after in pairwise(carries):
        assert after.start == pytest.approx(before.goal)


def test_robots_hold_from_gripping_to_putting_down(up: CooperativePlan) -> None:
    kinds = [type(step) for step in steps_of(up, "A")]
    assert holding_steps(up) == range(kinds.index(TakeHold) + 1, kinds.index(PutDown) + 1)
    idle = [structs.replace(subplan, steps=(Idle(),) * len(kinds)) for subplan in up.subplans]
    assert not holding_steps(structs.replace(up, subplans=tuple(idle)))


def test_carriers_wait_clear_of_the_doors_and_pass_them_in_time(world: MapWorld, up: CooperativePlan) -> None:
    steps = steps_of(up, "A")
    called = next(number for number, step in enumerate(steps) if isinstance(step, CallCabin))
    assert up.phases[called - 1 : called + 4] == (
        *("carrying", "waiting for the cabin", "driving in", "riding", "driving out"),
    )
    assert isinstance(steps[called + 2], Ride) and steps[called + 2].destination == "L2"
    shaft = shaft_polygon(world.building().elevators["E1"])
    footprint = MoveTablePlanner(world, "box", GOAL)._carry.footprint()

    def at(pose: tuple[float, float, float]) -> bool:
        return bool(translate(rotate(footprint, pose[2], (0, 0), use_radians=True), *pose[:2]).intersects(shaft))

    way_in, way_out = (steps[called + 1], steps[called + 3])
    assert isinstance(way_in, Carry) and isinstance(way_out, Carry)
    for step in (way_in, way_out):
        trajectory = Trajectory.from_rows(step.rows)
        assert trajectory.duration <= BOARDING_LIMIT_S - DOOR_MARGIN_S
        ends = trajectory.start, trajectory.goal
        inside, outside = ends if step is way_out else ends[::-1]
        assert at(inside) and not at(outside)


def test_elevators_that_are_too_small_are_named() -> None:
    with pytest.raises(ImpossibleCarry, match="E1"):
        MoveTablePlanner(MapWorld(two_storeys(cabin_m=2.0)), "box", GOAL)


def test_doors_stay_open_for_as_long_as_the_party_needs() -> None:
    plan = MoveTablePlanner(MapWorld(two_storeys(cabin_m=7.0)), "box", Destination("L2", 3.0, 3.5)).plan(
        "m", "A", ROBOTS
    )
    steps = steps_of(plan, "A")
    number, call = next((number, step) for number, step in enumerate(steps) if isinstance(step, CallCabin))
    through = [steps[number + 1], steps[number + 3]]
    durations = [Trajectory.from_rows(step.rows).duration for step in through if isinstance(step, Carry)]
    assert max(durations) > BOARDING_LIMIT_S - DOOR_MARGIN_S
    assert call.boarding_s == max(durations) + SUCCESSION_S


def test_doors_that_close_too_early_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(move_table, "MAX_BOARDING_S", 15.0)
    world = MapWorld(two_storeys(cabin_m=7.0))
    with pytest.raises(MissionFailed, match=r"the doors of E1 stay open for 15 s at most; driving in needs \d\d s"):
        MoveTablePlanner(world, "box", Destination("L2", 3.0, 3.5)).plan("m", "A", ROBOTS)


def standing(name: str, x: float, y: float, floor: str = "L1") -> StandingRobot:
    return StandingRobot(name, floor, x, y, RADIUS_M)


def test_robots_in_the_way_are_to_step_aside() -> None:
    team = [standing(name, place.x, place.y, place.floor) for name, place in ROBOTS.items()]
    goal = Destination("L1", 3.0, 5.0)
    world = MapWorld(two_storeys(), standing=[*team, standing("D", 4.6, 4.2), standing("E", 11.0, 6.0)])
    planner = MoveTablePlanner(world, "box", goal)
    with pytest.raises(InTheWay) as blocked:
        planner.plan("m", "A", ROBOTS)
    assert blocked.value.aside.keys() == {"D"}
    aside = blocked.value.aside["D"]
    assert aside and aside[0] == "L1"
    in_the_way, world.standing[3] = world.standing[3], standing("D", *aside[1:])
    assert planner.plan("m", "A", ROBOTS).thing == "box"
    world.standing[3] = in_the_way  # it comes back while the box is carried
    assert planner.aside("D") == aside


def test_the_carry_is_planned_around_robots_that_stay() -> None:
    goal = Destination("L1", 2.0, 3.5)
    direct = MapWorld(two_storeys())
    robots = {"A": Place("L1", 5.4, 1.5), "B": Place("L1", 5.4, 5.5)}
    ways = []
    for world in (direct, MapWorld(two_storeys(), standing=[standing("D", 3.7, 3.5)])):
        planner = MoveTablePlanner(world, "box", goal)
        planner.reserve(first_way, {"D"})
        plan = planner.plan("m", "A", robots, {"D"})
        step = next(step for step in steps_of(plan, "A") if isinstance(step, Reserve))
        ways.append(Polygon(step.areas[0][1]))
    assert ways[0].distance(Point(3.7, 3.5)) == 0.0
    assert ways[1].distance(Point(3.7, 3.5)) > 0.0  # RADIUS_M less what the outline is simplified by
    narrow = MapWorld(two_storeys(), standing=[standing("D", 2.0, 3.5)])
    with pytest.raises(ImpossibleCarry, match=r"L1:2,3.5 is not free for the object; robot 'D' on L1: is in the obj"):
        MoveTablePlanner(narrow, "box", goal).reserve(first_way, {"D"})


def test_the_number_of_carriers_follows_from_the_weight(world: MapWorld) -> None:
    assert MoveTablePlanner(world, "box", GOAL).helpers == 1
    assert MoveTablePlanner(MapWorld(two_storeys(), mass_kg=9.0), "box", Destination("L1", 3.5, 3.5)).helpers == 2
    assert MoveTablePlanner(MapWorld(two_storeys()), "box", Destination("L1", 3.5, 3.5), carriers=3).helpers == 2
    with pytest.raises(MissionFailed, match=r"box has a mass of 9 kg, and each .* 4 kg: it needs 3 carriers, not 2"):
        MoveTablePlanner(MapWorld(two_storeys(), mass_kg=9.0), "box", GOAL, carriers=2)


def test_missing_objects_and_robots_are_named(world: MapWorld) -> None:
    with pytest.raises(MissionFailed, match="no object 'piano'"):
        MoveTablePlanner(world, "piano", GOAL)
    with pytest.raises(MissionFailed, match="2 robots are needed; A are free"):
        MoveTablePlanner(world, "box", GOAL).plan("m", "A", {"A": ROBOTS["A"]})


def test_what_is_at_its_goal_is_not_carried(world: MapWorld) -> None:
    box = world.movable("box")
    with pytest.raises(GoalReached, match="box is at its goal"):
        MoveTablePlanner(world, "box", Destination(box.floor, box.x + 0.005, box.y, box.heading + math.tau))
    assert MoveTablePlanner(world, "box", Destination(box.floor, box.x + 0.1, box.y, box.heading)).helpers
