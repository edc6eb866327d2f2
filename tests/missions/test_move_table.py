"""Plans of move_table: how robots gather around the object, which one carries where, also through an elevator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as some
from msgspec import structs
from shapely import Point, Polygon

from robocorba.errors.paths import NotFree
from robocorba.errors.robots import GoalReached, ImpossibleCarry, InTheWay, MissionFailed
from robocorba.map_editor.geometry import Obstacle, shaft_polygon
from robocorba.map_editor.model import CabinSide, Elevator, ElevatorDoor
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.missions import move_table
from robocorba.missions.formation import BACK_OFF_M
from robocorba.missions.gathering import GatheringPaths, assign_places, driving_groups, spread_apart
from robocorba.missions.move_table import DOOR_MARGIN_S, SUCCESSION_S, MoveTablePlanner
from robocorba.missions.obstacles import placed
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
from robocorba.missions.world import MovableObject, StandingRobot
from robocorba.planning.request import MAX_AREAS, Place
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.programs.icons import Destination
from robocorba.simulation.elevator import BOARDING_LIMIT_S
from testkit.buildings import two_storeys, with_all
from tests.missions.places import MapWorld, first_way


class MovedWorld(MapWorld):
    """The box is not where the map has it."""

    def movable(self, name: str) -> MovableObject:
        return super().movable(name)._replace(x=2.4, y=3.5, heading=0.0)


def test_a_box_is_avoided_and_carried_from_where_it_is_now() -> None:
    world = MovedWorld(two_storeys())
    paths = GatheringPaths(world, world.movable("box"))
    assert paths.length_m(Place("L1", 5.4, 3.5), Place("L1", 5.4, 2.5)) is not None
    assert paths.length_m(Place("L1", 5.4, 2.5), Place("L1", 2.4, 3.5)) is None
    with pytest.raises(NotFree, match="to box, which stands there now"):
        paths.path(Place("L1", 5.4, 2.5), Place("L1", 2.4, 3.5))
    on_map = MapWorld(two_storeys())
    assert GatheringPaths(on_map, on_map.movable("box")).length_m(Place("L1", 5.4, 3.5), Place("L1", 5.4, 2.5)) is None
    beside = {"A": Place("L1", 5.4, 3.5), "B": Place("L1", 5.4, 5.0)}  # A is at the box's place on the map
    plan = MoveTablePlanner(MovedWorld(two_storeys()), "box", Destination("L1", 4.0, 3.5)).plan("m", "A", beside)
    assert {subplan.robot for subplan in plan.subplans} == {"A", "B"}


class FullWorld(MovedWorld):
    """There are more objects than fit into a path request."""

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        crate = shapely.box(11.0, 6.0, 11.1, 6.1)
        return {"L1": [Obstacle("object", f"crate{number}", crate) for number in range(MAX_AREAS)]}


def test_too_many_objects_are_taken_from_the_map() -> None:
    world = FullWorld(two_storeys())
    assert GatheringPaths(world, world.movable("box")).length_m(Place("L1", 5.4, 3.5), Place("L1", 5.4, 2.5)) is None


@settings(deadline=None)
@given(
    some.lists(some.tuples(some.floats(-1, 1), some.floats(-1, 1)), min_size=1, max_size=4, unique=True),
    some.floats(0.1, 1.0),
)
def test_places_are_spread_apart(at: list[tuple[float, float]], apart_m: float) -> None:
    places: list[Pose2D] = [(x, y, 0.5) for x, y in at]
    found = spread_apart(places, apart_m)
    assert [heading for *_, heading in found] == [0.5] * len(at)
    for i, one in enumerate(found):
        for k in range(i):
            assert math.dist(one[:2], found[k][:2]) > 0.5 * apart_m or math.dist(at[i], at[k]) < 1e-3
    if all(math.dist(a, b) >= apart_m for i, a in enumerate(at) for b in at[:i]):
        assert found == places


@pytest.mark.parametrize(
    ("floors", "paths", "groups"),
    [
        (("L1", "L1"), [[(0.0, 0.0), (4.0, 0.0)], [(0.0, 3.0), (4.0, 3.0)]], [{0, 1}]),
        (
            ("L1", "L1", "L2"),
            [[(0.0, 1.0), (2.0, 0.0)], [(0.0, -1.0), (2.0, -0.5), (4.0, 0.0)], [(3.0, 5.0), (4.0, 0.5), (6.0, 0.0)]],
            [{2}, {1}, {0}],
        ),
        (("L1", "L1"), [[(0.0, 0.0), (4.0, 0.0)], [(2.0, 0.0), (2.0, 3.0)]], [{1}, {0}]),
        (("L1", "L1"), [[(0.0, 0.0), (4.0, 0.0)], [(4.0, 0.0), (0.0, 0.0)]], [{0, 1}]),
    ],
    ids=("separate paths", "paths past goals of others", "a start on a path", "a cycle"),
)
def test_groups_that_drive_simultaneously(
    floors: tuple[str, ...], paths: list[list[tuple[float, float]]], groups: list[set[int]]
) -> None:
    drives = [(Place(floor, *path[0]), Place("L1", *path[-1])) for floor, path in zip(floors, paths, strict=True)]
    assert driving_groups(drives, paths) == groups


@settings(deadline=None)
@given(some.lists(some.tuples(*[some.floats(0, 9)] * 4), min_size=1, max_size=6))
def test_each_robot_drives_once(paths: list[tuple[float, float, float, float]]) -> None:
    lines = [((x, y), (goal_x, goal_y)) for x, y, goal_x, goal_y in paths]
    found = driving_groups([(Place("L1", *start), Place("L1", *goal)) for start, goal in lines], lines)
    assert sorted(number for group in found for number in group) == list(range(len(paths)))


# ---- who gathers where ----

WEST, MIDDLE, EAST = (Place("L1", x, 1.3) for x in (2.4, 3.3, 6.0))


def straight(one: Place, other: Place) -> float | None:
    return math.dist(one[1:], other[1:])


@pytest.mark.parametrize("leader", ["A", "B"])
def test_a_robot_beside_the_object_moves_on_for_one_that_arrives(leader: str) -> None:
    assert assign_places({"A": MIDDLE, "B": EAST}, [WEST, MIDDLE], leader, straight) == ["A", "B"]
    assert assign_places({"A": MIDDLE, "B": EAST}, [MIDDLE, WEST], leader, straight) == ["B", "A"]


@pytest.mark.parametrize(("leader", "carriers"), [("A", {"A", "B"}), ("B", {"B", "C"})])
def test_the_nearest_robots_and_the_leader_are_chosen(leader: str, carriers: set[str]) -> None:
    robots = {"A": Place("L1", 900.0, 0.0), "B": MIDDLE, "C": EAST}
    assert set(assign_places(robots, [WEST, MIDDLE], leader, straight)) == carriers


def test_robots_get_places_that_they_can_reach() -> None:
    def length_m(start: Place, goal: Place) -> float | None:
        return None if (start, goal) == (EAST, MIDDLE) or start.floor != goal.floor else straight(start, goal)

    assert assign_places({"A": MIDDLE, "B": EAST}, [WEST, MIDDLE], "A", length_m) == ["B", "A"]
    for robots, reason in (
        ({"A": EAST, "B": EAST}, r"no robot can reach L1 \(3\.30, 1\.30\) beside the object$"),
        ({"A": EAST, "B": Place("L2", 1.0, 1.0)}, r"no robot can reach L1 .* beside the object; on other floors: B"),
        ({"A": EAST}, "2 robots are needed; A are free"),
    ):
        with pytest.raises(MissionFailed, match=reason):
            assign_places(robots, [MIDDLE, WEST], "A", length_m)


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


def test_roles_first_steps_and_carries_that_start_where_the_one_before_ended(up: CooperativePlan) -> None:
    assert {subplan.robot: subplan.role for subplan in up.subplans} == {"A": "leader", "B": "helper"}
    assert len({len(subplan.steps) for subplan in up.subplans} | {len(up.phases)}) == 1
    reserve = steps_of(up, "A")[0]
    assert isinstance(reserve, Reserve) and isinstance(steps_of(up, "B")[0], Idle)
    assert [floor for floor, _ in reserve.areas] == ["L1", "L2"]
    here, there = (Polygon(corners) for _, corners in reserve.areas)
    assert there.contains(Point(GOAL.x, GOAL.y))
    for subplan in up.subplans:
        gather, approach, hold = subplan.steps[1:4]
        assert isinstance(gather, Gather) and isinstance(approach, Approach) and isinstance(hold, TakeHold)
        assert here.contains(Point(gather.x, gather.y))
        assert math.dist((gather.x, gather.y), (approach.x, approach.y)) == pytest.approx(BACK_OFF_M)
        faces = math.atan2(hold.y - approach.y, hold.x - approach.x)
        assert math.remainder(faces - approach.heading, math.tau) == pytest.approx(0.0, abs=1e-9)
        assert math.dist((hold.x, hold.y), (approach.x, approach.y)) > RADIUS_M
    a, b = (subplan.steps[1] for subplan in up.subplans)
    assert isinstance(a, Gather) and isinstance(b, Gather)
    assert up.subplans[0].robot == ("A" if a.y < b.y else "B")  # each from its own side
    carries = [Trajectory.from_rows(step.rows) for step in steps_of(up, "A") if isinstance(step, Carry)]
    assert carries[0].start == pytest.approx((5.4, 3.5, -0.785))
    assert carries[-1].goal == pytest.approx((GOAL.x, GOAL.y, GOAL.heading))
    for before, after in pairwise(carries):
        assert after.start == pytest.approx(before.goal)
    kinds = [type(step) for step in steps_of(up, "A")]
    assert holding_steps(up) == range(kinds.index(TakeHold) + 1, kinds.index(PutDown) + 1)
    idle = [structs.replace(subplan, steps=(Idle(),) * len(kinds)) for subplan in up.subplans]
    assert not holding_steps(structs.replace(up, subplans=tuple(idle)))


def test_carriers_wait_clear_of_the_doors_and_pass_them_in_time(world: MapWorld, up: CooperativePlan) -> None:
    steps = steps_of(up, "A")
    called, call = next((number, step) for number, step in enumerate(steps) if isinstance(step, CallCabin))
    assert (call.party, call.size) == ("m to L2", 2)
    assert up.phases[called - 1 : called + 4] == (
        *("carrying", "waiting for the cabin", "driving in", "riding", "driving out"),
    )
    assert isinstance(steps[called + 2], Ride) and steps[called + 2].destination == "L2"
    shaft = shaft_polygon(world.building().elevators["E1"])
    footprint = MoveTablePlanner(world, "box", GOAL).footprint
    way_in, way_out = steps[called + 1], steps[called + 3]
    assert isinstance(way_in, Carry) and isinstance(way_out, Carry)
    for step in (way_in, way_out):
        trajectory = Trajectory.from_rows(step.rows)
        assert trajectory.duration <= BOARDING_LIMIT_S - DOOR_MARGIN_S
        at_shaft = [placed(footprint, pose).intersects(shaft) for pose in (trajectory.start, trajectory.goal)]
        assert at_shaft == [step is way_out, step is way_in]


def test_doors_stay_open_for_as_long_as_the_party_needs_or_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def planned() -> CooperativePlan:
        return MoveTablePlanner(world, "box", Destination("L2", 3.0, 3.5)).plan("m", "A", ROBOTS)

    world = MapWorld(two_storeys(cabin_m=7.0))
    steps = steps_of(planned(), "A")
    number, call = next((number, step) for number, step in enumerate(steps) if isinstance(step, CallCabin))
    through = [steps[number + 1], steps[number + 3]]
    durations = [Trajectory.from_rows(step.rows).duration for step in through if isinstance(step, Carry)]
    assert max(durations) > BOARDING_LIMIT_S - DOOR_MARGIN_S
    assert call.boarding_s == max(durations) + SUCCESSION_S
    monkeypatch.setattr(move_table, "MAX_BOARDING_S", 15.0)
    with pytest.raises(MissionFailed, match=r"the doors of E1 stay open for 15 s at most; driving in needs \d\d s"):
        planned()


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


def test_carriers_follow_from_the_weight_and_what_is_missing_or_at_its_goal_is_named(world: MapWorld) -> None:
    assert MoveTablePlanner(world, "box", GOAL).helpers == 1
    assert MoveTablePlanner(MapWorld(two_storeys(), mass_kg=9.0), "box", Destination("L1", 3.5, 3.5)).helpers == 2
    assert MoveTablePlanner(MapWorld(two_storeys()), "box", Destination("L1", 3.5, 3.5), carriers=3).helpers == 2
    with pytest.raises(MissionFailed, match=r"box has a mass of 9 kg, and each .* 4 kg: it needs 3 carriers, not 2"):
        MoveTablePlanner(MapWorld(two_storeys(), mass_kg=9.0), "box", GOAL, carriers=2)
    with pytest.raises(MissionFailed, match="no object 'piano'"):
        MoveTablePlanner(world, "piano", GOAL)
    with pytest.raises(MissionFailed, match="2 robots are needed; A are free"):
        MoveTablePlanner(world, "box", GOAL).plan("m", "A", {"A": ROBOTS["A"]})
    with pytest.raises(ImpossibleCarry, match="E1"):
        MoveTablePlanner(MapWorld(two_storeys(cabin_m=2.0)), "box", GOAL)
    box = world.movable("box")
    with pytest.raises(GoalReached, match="box is at its goal"):
        MoveTablePlanner(world, "box", Destination(box.floor, box.x + 0.005, box.y, box.heading + math.tau))
    assert MoveTablePlanner(world, "box", Destination(box.floor, box.x + 0.1, box.y, box.heading)).helpers
