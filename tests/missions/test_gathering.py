"""How robots gather: around objects at their present poses, apart from each other, each at the right place."""

from __future__ import annotations

import math

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as some

from robocorba.errors.paths import NotFree
from robocorba.errors.robots import MissionFailed
from robocorba.map_editor.geometry import Obstacle
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.missions.gathering import SPACING_M, GatheringPaths, assign_places, driving_groups, spread_apart
from robocorba.missions.move_table import MoveTablePlanner
from robocorba.missions.world import MovableObject
from robocorba.planning.request import MAX_AREAS, Place
from robocorba.robot.programs.icons import Destination
from testkit.buildings import two_storeys
from tests.missions.worlds import MapWorld


class MovedWorld(MapWorld):
    """The box is not where the map has it."""

    def movable(self, name: str) -> MovableObject:
        return super().movable(name)._replace(x=2.4, y=3.5, heading=0.0)


def test_paths_avoid_the_object_where_it_is_now() -> None:
    world = MovedWorld(two_storeys())
    paths = GatheringPaths(world, world.movable("box"))
    assert paths.length_m(Place("L1", 5.4, 3.5), Place("L1", 5.4, 2.5)) is not None
    assert paths.length_m(Place("L1", 5.4, 2.5), Place("L1", 2.4, 3.5)) is None
    with pytest.raises(NotFree, match="to box, which stands there now"):
        paths.path(Place("L1", 5.4, 2.5), Place("L1", 2.4, 3.5))
    on_map = MapWorld(two_storeys())
    assert GatheringPaths(on_map, on_map.movable("box")).length_m(Place("L1", 5.4, 3.5), Place("L1", 5.4, 2.5)) is None


def test_a_moved_box_can_be_carried_again() -> None:
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


def test_carriers_side_by_side_gather_apart() -> None:
    first, second = spread_apart([(0.0, 0.41, 0.0), (0.0, -0.41, 0.0)])
    assert math.dist(first[:2], second[:2]) == pytest.approx(0.8 + SPACING_M)
    assert first[0] == second[0] == 0.0


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


def test_the_nearest_robots_and_the_leader_are_chosen() -> None:
    robots = {"A": Place("L1", 900.0, 0.0), "B": MIDDLE, "C": EAST}
    assert set(assign_places(robots, [WEST, MIDDLE], "A", straight)) == {"A", "B"}
    assert set(assign_places(robots, [WEST, MIDDLE], "B", straight)) == {"B", "C"}


def test_robots_get_places_that_they_can_reach() -> None:
    def length_m(start: Place, goal: Place) -> float | None:
        return None if (start, goal) == (EAST, MIDDLE) else straight(start, goal)

    assert assign_places({"A": MIDDLE, "B": EAST}, [WEST, MIDDLE], "A", length_m) == ["B", "A"]
    with pytest.raises(MissionFailed, match=r"no robot can reach L1 \(3\.30, 1\.30\) beside the object"):
        assign_places({"A": EAST, "B": EAST}, [MIDDLE, WEST], "A", length_m)


def test_robots_that_are_missing_on_other_floors_are_named() -> None:
    def length_m(start: Place, goal: Place) -> float | None:
        return None if start.floor != goal.floor else straight(start, goal)

    with pytest.raises(MissionFailed, match=r"no robot can reach L1 .* beside the object; on other floors: B"):
        assign_places({"A": EAST, "B": Place("L2", 1.0, 1.0)}, [MIDDLE, WEST], "A", length_m)


def test_too_few_robots_are_refused() -> None:
    with pytest.raises(MissionFailed, match="2 robots are needed; A are free"):
        assign_places({"A": EAST}, [WEST, MIDDLE], "A", straight)
