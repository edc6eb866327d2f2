"""Robots of every accepted description at walls, corners, doors and other robots: none gets through, none deep in."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Sequence

import pytest
from shapely import LineString, Point

from robocorba.map_editor.spatial.pose import Limits, Pose
from robocorba.simulation.physics import STEP_S, FloorPhysics
from robocorba.simulation.registry import Description
from robocorba.simulation.substeps import max_penetration_m

#: Half the length of a wall that nobody can go around [m].
FAR_M = 900.0
WALL = LineString([(0.0, -FAR_M), (0.0, FAR_M)])
LONGEST_S = 6.0


def extreme(chance: random.Random, low: float, high: float) -> float:
    """A value between two limits: often one of them, else all orders of magnitude alike."""
    return chance.choice((low, high, math.exp(chance.uniform(math.log(low), math.log(high)))))


def described(chance: random.Random, at: Pose) -> Description:
    radius_m = extreme(chance, 0.05, 5.0)
    speed = extreme(chance, 0.2, 10.0)
    limits = Limits(speed, extreme(chance, 0.5, 4 * math.pi), extreme(chance, 0.5, 50.0), extreme(chance, 0.5, 50.0))
    return Description("R", at, radius_m, extreme(chance, 0.1, 10_000.0), limits)


def row_of_robots(chance: random.Random, count: int) -> list[Description]:
    """Robots left of x = 0, one behind the other."""
    right, robots = 0.0, []
    for _ in range(count):
        about = described(chance, Pose("L1", 0.0, 0.0))
        x = right - about.radius_m - chance.choice((0.001, 0.05, chance.uniform(0.0, 1.5)))
        y = chance.uniform(-0.3, 0.3) * about.radius_m
        robots.append(Description("R", Pose("L1", x, y), about.radius_m, about.mass_kg, about.limits))
        right = x - about.radius_m
    return robots


def deepest(floor: FloorPhysics, robots: Sequence[Description], walls: Sequence[LineString]) -> float:
    """The deepest penetration, in units of what is allowed."""
    state = floor.state()
    at = [Point(state[f"R{i}"][:2]) for i in range(len(robots))]
    allowed = [max_penetration_m(about.radius_m) for about in robots]
    found = [
        (about.radius_m - wall.distance(at[i])) / allowed[i] for i, about in enumerate(robots) for wall in walls
    ] + [
        (robots[i].radius_m + robots[k].radius_m - at[i].distance(at[k])) / (allowed[i] + allowed[k])
        for i, k in itertools.combinations(range(len(robots)), 2)
    ]
    return max(found)


@pytest.mark.parametrize("place", ["wall", "corner", "door", "standing", "row", "around"])
@pytest.mark.parametrize("seed", range(4))
def test_no_robot_gets_through_a_wall_or_another_robot(place: str, seed: int) -> None:
    chance = random.Random(f"{place}{seed}")
    robots = row_of_robots(chance, {"standing": 2, "row": 3, "around": 3}.get(place, 1))
    beside = 1.4 * robots[0].radius_m + 0.1
    walls = [WALL, LineString([(0.0, beside), (-FAR_M, beside)])] if place == "corner" else [WALL]
    floor = FloorPhysics([] if place == "door" else walls)
    if place == "door":
        floor.close_door("door", WALL)
    for i, about in enumerate(robots):
        floor.add_robot(f"R{i}", about.pose[1:], about.radius_m, about.mass_kg, about.limits)
    first = 1 if place == "standing" else 0
    sideways = [chance.choice((0.0, chance.uniform(-1.0, 1.0))) for _ in robots]
    slowest = min(about.limits.speed for about in robots)
    for step in range(round(min(LONGEST_S, 1.0 + 4.0 / slowest) / STEP_S)):
        for i, about in enumerate(robots[first:], first):
            if place == "around" and step % 25 == 0:
                sideways[i] = chance.uniform(-math.pi, math.pi)
            angle = abs(sideways[i]) if place == "corner" else sideways[i]
            speed = about.limits.speed
            floor.command(f"R{i}", speed * math.cos(angle), speed * math.sin(angle), 0.0, 0.3)
        floor.step()
        assert deepest(floor, robots, walls) <= 1.0
        assert all(floor.row(f"R{i}")[0] < 0.0 for i in range(len(robots)))


@pytest.mark.parametrize(("radius_m", "speed"), [(0.05, 2.0), (0.05, 10.0), (0.09, 4.0), (0.4, 1.75), (0.4, 10.0)])
def test_robots_that_meet_head_on_stop_each_other(radius_m: float, speed: float) -> None:
    floor = FloorPhysics()
    for name, x, heading in (("A", -1.0, 0.0), ("B", 1.0, math.pi)):
        floor.add_robot(name, (x, 0.0, heading), radius_m, 20.0, Limits(speed, 1.0, 20.0, 1.0))
        floor.command(name, speed, 0.0, 0.0)
    for _ in range(100):
        floor.step()
        state = floor.state()
        overlap_m = 2 * radius_m - math.dist(state["A"][:2], state["B"][:2])
        assert overlap_m <= 2 * max_penetration_m(radius_m)
    assert state["A"][0] < state["B"][0]


def test_a_light_robot_weighs_again_what_it_says_once_heavy_ones_have_left() -> None:
    floor = FloorPhysics()
    floor.add_robot("light", (0.0, 0.0, 0.0), 0.1, 1.0, Limits())
    floor.add_robot("heavy", (5.0, 0.0, 0.0), 1.0, 1000.0, Limits())
    floor.step()
    assert floor._bodies["light"].mass == pytest.approx(100.0)
    floor.remove("heavy")
    floor.step()
    assert floor._bodies["light"].mass == pytest.approx(1.0)
