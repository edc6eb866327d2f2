"""What the stand-in senses of its own world, and how that stops its base."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.frames import Frame
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.senses import nearest_m
from robocorba.robot.smartpal_stand_in.codes import MobilityState, ReturnCode
from robocorba.robot.smartpal_stand_in.segment import from_frame
from robocorba.robot.smartpal_stand_in.world import PARTING_M, World
from robocorba.simulation.sensing.scan import Noise
from tests.robot.smartpal.robots import ready, run, until_stopped

WALL = LineString([(-3.0, 2.0), (3.0, 2.0)])
CHAIR = shapely.box(1.0, -0.3, 1.5, 0.2)
#: A step of a base that is as fast as it can be [m, rad].
STEP = 0.02


def state(base: Frame, time: float = 0.0) -> Any:
    return SimpleNamespace(time=time, true_base=np.array(base))


def distance(shapes: list[BaseGeometry], at: Frame) -> float:
    return min(shape.distance(Point(at[:2])) for shape in shapes)


moves = st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.integers(1, 60)), max_size=12)


@given(moves, st.floats(-math.pi, math.pi))
@settings(max_examples=20, deadline=None)
def test_a_base_touches_and_does_not_enter_and_each_contact_counts_once(
    drives: list[tuple[float, float, int]], heading: float
) -> None:
    """Against a model that asks shapely: a contact begins within the radius, and ends a little farther away."""
    shapes = [WALL, CHAIR, Polygon([(-1.0, -2.0), (0.4, -1.5), (-2.0, -1.0)])]
    start = (0.1, 0.3, heading)
    world = World(shapes, start)
    base, contacts, is_touching = (0.0, 0.0, 0.0), 0, False
    for vx, vy, steps in drives:
        for _ in range(steps):
            gap = distance(shapes, from_frame(start, base)) - RADIUS_M
            if is_touching and gap > PARTING_M:
                is_touching = False
            if not is_touching and gap <= 0.0:
                is_touching, contacts = True, contacts + 1
            speed = max(1.0, math.hypot(vx, vy))
            wanted = np.array([vx / speed, vy / speed, 0.5])
            x, y, turn = world.allowed(state(base), wanted).tolist()
            assert world.contacts == contacts
            assert turn == 0.5
            assert math.hypot(x, y) <= math.hypot(*wanted[:2]) + 1e-9
            if gap > 0.0:
                assert (x, y) == pytest.approx(wanted[:2].tolist())
            base = base[0] + STEP * x, base[1] + STEP * y, base[2] + STEP * turn
            assert distance(shapes, from_frame(start, base)) > RADIUS_M - 2 * STEP
    (bumper,) = world.readings()
    assert (bumper.name, bumper.unit, bumper.value) == ("bumper", "contacts", contacts)


def test_the_robot_stands_before_a_chair_that_no_map_has() -> None:
    robot = ready()
    world = World([CHAIR])
    robot.dynamics.allowed = world.allowed
    jogged = 0.0
    while world.contacts == 0:
        assert robot.mobility.jog(300.0, 0.0, 0.0) is ReturnCode.OK
        run(robot, 0.1)
        jogged += 0.1
        assert jogged < 5.0
    until_stopped(robot)
    run(robot, 0.5)
    x, y, _ = robot.dynamics.state.true_base
    assert x == pytest.approx(1.0 - RADIUS_M, abs=0.01) and abs(y) < 0.01
    assert robot.mobility.mobility_state is MobilityState.STUCK
    assert nearest_m(world, "front") == pytest.approx(0.0, abs=0.01)
    assert nearest_m(world, "left") == 1.0
    assert (world.contacts, world.readings()[0].time) == (1, pytest.approx(robot.dynamics.state.time, abs=0.01))


def test_it_sees_where_it_is_whatever_its_odometry_says() -> None:
    world = World([WALL, CHAIR], (-1.0, 1.0, math.pi / 2))
    assert nearest_m(world, "front") == pytest.approx(1.0 - RADIUS_M, abs=1e-6)
    world.allowed(state((0.3, 0.2, -math.pi / 2), 4.5), np.zeros(3))  # at -1.2, 1.3, along x
    assert nearest_m(world, "left") == pytest.approx(0.7 - RADIUS_M, abs=1e-6)
    seen = world.ranges("laser")
    assert seen.time == 4.5
    for angle, measured in zip(world.sensor("laser").spec.fan.angles, seen.distances, strict=True):
        ray = LineString([(-1.2, 1.3), (-1.2 + 8.0 * math.cos(angle), 1.3 + 8.0 * math.sin(angle))])
        hits = [ray.intersection(shape) for shape in (WALL, CHAIR)]
        expected = min((Point(-1.2, 1.3).distance(hit) for hit in hits if not hit.is_empty), default=8.0)
        assert measured == pytest.approx(expected, abs=1e-6)


def test_distances_have_noise_and_drop_outs() -> None:
    world = World([WALL], (0.0, 0.0, math.pi / 2), Noise(0.02, lost=0.2), seed=3)
    ahead = np.array([world.ranges("laser").distances[90] for _ in range(500)])
    seen = ahead[ahead < 8.0]
    assert 350 < len(seen) < 450
    assert (seen.mean(), seen.std()) == (pytest.approx(2.0, abs=0.01), pytest.approx(0.02, rel=0.2))
