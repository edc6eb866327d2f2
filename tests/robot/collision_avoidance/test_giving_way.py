"""Giving way: robots never touch, with the rules alone, and in the simulated building."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as some
from shapely import Point, Polygon

from robocorba.errors.robots import MotionFailed
from robocorba.errors.services import NotReachable
from robocorba.map_editor.model import BoxShape, Building, Floor, FloorMap, GeometricalMap, MapObject, Wall
from robocorba.map_editor.samples import load_sample
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import turned
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.robot.collision_avoidance.giving_way import (
    MARGIN_M,
    NEAR_MARGIN_M,
    Blocked,
    GiveWay,
    safe_share,
    should_yield,
)
from robocorba.robot.collision_avoidance.neighbours import OtherRobot
from robocorba.robot.collision_avoidance.policy import GivingWayPolicy
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M
from robocorba.robot.motion.driving import STUCK_S, Drive
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.robot import Robot
from tests.robot.collision_avoidance.crowd import FLOOR, Crowd
from tests.robot.stepped_robot import Alone

TICK_S, KNOWN_LATE_TICKS = 0.02, 3


class Base(Alone):
    """A base with the greatest acceleration, and a record of its states. wall_y: the only obstacle."""

    def __init__(self, name: str, x: float, y: float, wall_y: float = math.inf) -> None:
        self.name, self.state, self.wall_y = name, RobotState(0.0, x, y, 0.0), wall_y
        self.past: list[OtherRobot] = []
        self.awaited: set[str] = set()
        self.neighbours: list[Base] = []
        self.look()

    def look(self) -> None:
        state = self.state
        vx, vy = turned(*state.velocity[:2], state.heading)
        self.past.append(OtherRobot(self.name, state.x, state.y, vx, vy, state.heading, RADIUS_M))

    def others(self, x: float, y: float) -> list[OtherRobot]:
        """As they were some ticks ago, extrapolated to the present."""
        found = [base.past[-KNOWN_LATE_TICKS:][0] for base in self.neighbours]
        late_s = KNOWN_LATE_TICKS * TICK_S
        return [one._replace(x=one.x + one.vx * late_s, y=one.y + one.vy * late_s) for one in found]

    def shaft(self, elevator: str) -> Polygon | None:
        return None

    def clearance_m(self, x: float, y: float) -> float:
        return self.wall_y - y

    def seen_around(self, x: float, y: float) -> Floats:
        corners = [corner for _, outline in self.seen.forbidden_areas for corner in outline]
        return np.array(corners).reshape(-1, 2) - (x, y)

    def seen_on(self, line: Sequence[XY], radius_m: float) -> str:
        return "".join(self.seen.near_line(FLOOR, line, radius_m))

    def go(self, velocity: tuple[float, float, float]) -> None:
        state = self.state
        vx, vy = turned(*state.velocity[:2], state.heading)
        wx, wy = turned(*velocity[:2], state.heading)
        share = min(1.0, BASE_LIMITS.acceleration * TICK_S / max(math.hypot(wx - vx, wy - vy), 1e-12))
        vx, vy = vx + share * (wx - vx), vy + share * (wy - vy)
        heading = state.heading + velocity[2] * TICK_S
        moving = *turned(vx, vy, -heading), velocity[2]
        self.state = RobotState(state.time + TICK_S, state.x + vx * TICK_S, state.y + vy * TICK_S, heading, moving)


def drive(bases: list[Base], motions: list[GiveWay], limit_s: float = 60.0) -> tuple[float, list[str]]:
    """Drive until all have arrived or failed: the least gap between two rims [m], and the end of each drive."""
    ends = [""] * len(bases)
    nearest_m = math.inf
    for base in bases:
        base.neighbours = [other for other in bases if other is not base]
    while not all(ends) and bases[0].state.time < limit_s:
        for number, (base, motion) in enumerate(zip(bases, motions, strict=True)):
            velocity = (0.0, 0.0, 0.0)
            if not ends[number]:
                try:
                    command = motion.command(base.state, base.state.time)
                    velocity = command.velocity if command else velocity
                    base.awaited |= {command.awaited} if command else set()
                    ends[number] = "" if command else "there"
                except MotionFailed as failed:
                    ends[number] = str(failed)
            base.go(velocity)
        for base in bases:
            base.look()
        for i, one in enumerate(bases):
            for other in bases[:i]:
                apart_m = math.dist((one.state.x, one.state.y), (other.state.x, other.state.y))
                nearest_m = min(nearest_m, apart_m - 2 * RADIUS_M)
    return nearest_m, ends


def paths(bases: Sequence[Base], goals: Sequence[XY], speeds: Sequence[float] = (0.4, 0.4)) -> list[GiveWay]:
    """Straight to their goals."""
    ways = zip(bases, goals, speeds, strict=True)
    return [GiveWay(Drive([goal], None, speed, BASE_LIMITS), base, [goal]) for base, goal, speed in ways]


PLACES = some.tuples(some.floats(-3.0, 3.0), some.floats(-3.0, 3.0))
SPEEDS = some.floats(0.2, 1.0)


@settings(deadline=None, max_examples=8)
@given(some.lists(some.tuples(PLACES, PLACES, SPEEDS), min_size=2, max_size=4))
@example([((-4.0, 0.0), (4.0, 0.0), 1.0), ((4.0, 0.0), (-4.0, 0.0), 1.0)])
@example([((-4.0, 0.0), (4.0, 0.0), 1.0), ((0.0, -4.0), (0.0, 4.0), 1.0)])
@example([((0.0, 0.0), (4.0, 0.0), 1.0), ((0.0, 1.0), (4.0, 0.0), 1.0), ((4.0, 0.0), (-4.0, 0.0), 0.5)])
def test_robots_never_touch(drives: list[tuple[XY, XY, float]]) -> None:
    starts = [start for start, _, _ in drives]
    assume(all(math.dist(a, b) > 2 * RADIUS_M + MARGIN_M for i, a in enumerate(starts) for b in starts[:i]))
    bases = [Base(f"r{number}", *start) for number, start in enumerate(starts)]
    goals, speeds = [goal for _, goal, _ in drives], [speed for *_, speed in drives]
    nearest_m, ends = drive(bases, paths(bases, goals, speeds), 120.0)  # at 0.2 m/s 8 m take a while
    assert nearest_m > 0.0
    assert all(ends), ends


def test_the_earlier_name_keeps_its_speed_at_a_crossing_and_head_on_both_stop() -> None:
    bases = [Base("a", -3.0, 0.0), Base("b", 0.0, -3.0)]
    goals = [(3.0, 0.0), (0.0, 3.0)]
    nearest_m, ends = drive(bases, paths(bases, goals))
    assert ends == ["there", "there"]
    assert nearest_m > MARGIN_M
    speeds = [[math.hypot(one.vx, one.vy) for one in base.past if abs(one.x) < 2 and abs(one.y) < 2] for base in bases]
    assert min(speeds[0]) > 0.39
    assert min(speeds[1]) < 0.2
    assert bases[0].awaited == {""}
    bases = [Base("a", -2.0, 0.0), Base("b", 2.0, 0.0)]
    goals = [(2.0, 0.0), (-2.0, 0.0)]
    nearest_m, ends = drive(bases, paths(bases, goals))
    assert NEAR_MARGIN_M - 0.005 < nearest_m < MARGIN_M + 0.02
    assert ends[0].endswith("b is in the way")
    assert ends[1].endswith("a is in the way")
    assert [base.awaited for base in bases] == [{"", f"a free way: {other} is in the way"} for other in "ba"]


def test_places_side_by_side_are_reached_and_a_robot_stops_before_a_wall() -> None:
    bases = [Base("a", 0.0, 0.0), Base("b", 3.0, 0.5)]
    goal = 0.82, 0.0
    motion = GiveWay(Drive([goal], 0.0, 0.3, BASE_LIMITS), bases[1], [goal])
    nearest_m, ends = drive(bases, [GiveWay(Drive([(0.0, 0.0)], 0.0, 0.3, BASE_LIMITS), bases[0]), motion])
    assert ends == ["there", "there"]
    assert nearest_m >= NEAR_MARGIN_M
    base = Base("a", 0.0, 0.0, wall_y=0.6)
    motion = GiveWay(Drive([(0.0, 0.5)], 0.0, 0.2, BASE_LIMITS), base, precise_positioning=True, avoid_walls=True)
    _, (end,) = drive([base], [motion])
    assert end.endswith("a wall or an object is in the way")
    assert base.state.y == pytest.approx(0.6 - RADIUS_M - 0.02, abs=0.005)


class Blind(Base):
    """Knows where others are only from a time on."""

    sees_from_s = math.inf

    def others(self, x: float, y: float) -> list[OtherRobot]:
        if self.state.time < self.sees_from_s:
            raise NotReachable("away")
        return super().others(x, y)


@pytest.mark.parametrize(
    ("sees_from_s", "ends", "x"), [(math.inf, "waited 20 s: away", 0.0), (STUCK_S * 2, "there", 1.0)]
)
def test_a_robot_does_not_drive_without_positions_of_others(sees_from_s: float, ends: str, x: float) -> None:
    """It goes on when it knows them again, though it has waited longer than a robot that is stuck would have."""
    base = Blind("a", 0.0, 0.0)
    base.sees_from_s = sees_from_s
    _, (end,) = drive([base], [GiveWay(Drive([(1.0, 0.0)], None, 0.4, BASE_LIMITS), base)])
    assert end == ends
    assert base.state.x == pytest.approx(x, abs=0.01 * x)


@given(PLACES, PLACES, some.tuples(some.floats(-1, 1), some.floats(-1, 1)))
def test_a_robot_inside_the_margin_may_drive_away(here: XY, there: XY, velocity: XY) -> None:
    state, other = RobotState(0.0, *here), OtherRobot("b", *there, 0.0, 0.0, 0.0, RADIUS_M)
    share = safe_share(state, *velocity, other, MARGIN_M)
    assert 0.0 <= share <= 1.0
    comes = (there[0] - here[0]) * velocity[0] + (there[1] - here[1]) * velocity[1] > 0.0
    if not comes:
        assert share == 1.0
    elif math.dist(here, there) < 2 * RADIUS_M + NEAR_MARGIN_M:
        assert share == 0.0
    assert not should_yield(state, *velocity, other)  # a stationary robot needs no path


@pytest.fixture(autouse=True)
def seed() -> None:
    random.seed(1)


def room(width: float, depth: float, *things: MapObject) -> Building:
    outline = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    ends = zip(outline, (*outline[1:], outline[0]), strict=True)
    walls = {f"w{number}": Wall(f"w{number}", a, b) for number, (a, b) in enumerate(ends)}
    plan = GeometricalMap(walls, {thing.name: thing for thing in things})
    return Building("room", {FLOOR: FloorMap(Floor(FLOOR, 1, 0.0, outline=outline), plan)})


def meet(crowd: Crowd, goals: Mapping[str, Sequence[float]]) -> None:
    """All robots reach their goals without a collision. goals: x, y [m], and a heading [rad] or none."""

    def go(goal: Sequence[float], robot: Robot) -> None:
        robot.drive_path(FLOOR, *goal, around_obstacles=True)

    wrong = crowd.run(150.0, **{name: partial(go, goal) for name, goal in goals.items()})
    assert (wrong, crowd.touched) == ({}, [])
    for name, goal in goals.items():
        assert crowd.at(name)[:2] == pytest.approx(goal[:2], abs=0.01)


def test_head_on_in_a_corridor_of_two_metres() -> None:
    crowd = Crowd(room(10.0, 2.0), {"A": (1.0, 1.0, 0.0), "B": (9.0, 1.0, math.pi)})
    meet(crowd, {"A": (9.0, 1.0, 0.0), "B": (1.0, 1.0, 0.0)})


def test_a_robot_waits_until_its_goal_is_free() -> None:
    crowd = Crowd(room(8.0, 4.0), {"A": (1.0, 2.0, 0.0), "B": (4.0, 2.0, 0.0)})

    def leave(robot: Robot) -> None:
        robot.wait(15.0)
        robot.drive_path(FLOOR, 7.0, 2.0)

    def come(robot: Robot) -> None:
        robot.drive_path(FLOOR, 4.0, 2.0, 0.0)

    assert crowd.run(150.0, A=come, B=leave) == {}
    assert crowd.touched == []
    assert crowd.at("A")[:2] == pytest.approx((4.0, 2.0), abs=0.01)


def test_a_robot_drives_around_what_is_parked_or_moved_and_past_its_place_on_the_map() -> None:
    box = MapObject("box", BoxShape((0.8, 0.8)), (6.0, 2.0), height=0.5, movable=True)
    crowd = Crowd(room(8.0, 4.0, box), {"A": (1.0, 2.0, 0.0), "B": (3.5, 2.0, 0.0)})
    crowd.carried("box", (1.0, 0.6))
    meet(crowd, {"A": (6.0, 2.0, 0.0)})
    box = MapObject("box", BoxShape((0.8, 0.8)), (7.0, 3.4), height=0.5, movable=True)
    crowd = Crowd(room(8.0, 4.0, box), {"A": (1.0, 2.0, 0.0)})
    crowd.carried("box", (4.0, 2.0))
    wrong = crowd.run(60.0, A=lambda robot: robot.drive_path(FLOOR, 4.0, 2.0))
    assert wrong["A"].startswith("goal L1:4,2 is not free: 0.000 m to box, which stands there now")
    meet(crowd, {"A": (7.0, 2.0)})


def test_corners_are_passed_with_clearance_to_a_place_beside_another_robot() -> None:
    crowd = Crowd(load_sample("paper-scene"), {"A": (3.9, 0.7, 0.0), "B": (9.02, 5.19, 0.0), "C": (6.66, 1.1, 0.0)})
    crowd.carried("table", (6.7, 3.1))
    meet(crowd, {"A": (6.7, 4.42), "B": (6.24, 1.78), "C": (7.16, 1.78)})  # where they gather


def test_the_blocking_robot_is_named() -> None:
    policy = GivingWayPolicy(max_blockages=1, max_search_s=1.0)
    crowd = Crowd(room(8.0, 1.0), {"A": (1.0, 0.5, 0.0), "B": (4.0, 0.5, 0.0)}, policy)
    wrong = crowd.run(60.0, A=lambda robot: robot.drive_path(FLOOR, 7.0, 0.5))
    assert wrong["A"].endswith("B is in the way")
    assert crowd.touched == []


@settings(deadline=None, max_examples=6)
@given(some.floats(0.2, 0.8), some.floats(-0.6, 0.6), some.floats(0.0, 1.0))
def test_a_base_stops_before_what_it_sees_and_passes_what_lies_beside(speed: float, y: float, after_s: float) -> None:
    """On a path it is blocked as soon as it sees what lies on it, else when it stands."""
    corner = FLOOR, ((2.0, y), (2.1, y), (2.05, y + 0.01))
    seen = TemporaryObstacles((corner,), names=("seen thing 1",))
    for path in ((), [(4.0, 0.0)]):
        base = Base("r", 0.0, 0.0)
        motion = GiveWay(Drive([(4.0, 0.0)], None, speed, BASE_LIMITS), base, path)
        nearest_m, failed = math.inf, ""
        while base.state.time < 60.0 and not failed:
            if base.state.time >= after_s:
                base.seen = seen
            try:
                command = motion.command(base.state, base.state.time)
            except Blocked as blocked:
                failed = str(blocked)
            if command is None:
                break
            base.go(command.velocity if not failed else (0.0, 0.0, 0.0))
            base.look()
            nearest_m = min(nearest_m, Polygon(corner[1]).distance(Point(base.state.x, base.state.y)))
        assert nearest_m > RADIUS_M
        is_in_the_way = -RADIUS_M - 0.01 < y < RADIUS_M
        assert ("seen thing 1" in failed) == (bool(path) and is_in_the_way)
        assert bool(failed) or not is_in_the_way
