"""Perception, in a room with things, some of which a map explains. Rays are a model of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import LinearRing, LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.perception import KEPT_S, LARGEST_M, MAX_CELLS, MAX_THINGS, Perception, SeenThing
from robocorba.robot.scans import Scan
from robocorba.robot.senses import RangeSensor
from robocorba.simulation.sensing.scan import LASER, Mount, ScanSpec
from testkit.processes import eventually
from tests.robot.places import Measured

RANGE_M, STEP_S, RADIUS_M = 8.0, 0.2, 0.40
ANGLES = np.arange(-180, 180) * math.pi / 180
ROOM = LinearRing([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
AT: Frame = (5.0, 5.0, 0.0)
AT_POINT = Point(AT[:2])


def scan_of(things: Sequence[BaseGeometry], at: Frame = AT, noise: Floats | float = 0.0) -> Scan:
    """Where rays around a robot meet the borders of things, or of the room, on the floor."""
    along = np.column_stack((np.cos(ANGLES), np.sin(ANGLES)))
    borders = shapely.union_all([ROOM, *(thing.boundary for thing in things)])
    rays = shapely.linestrings(np.stack((np.broadcast_to(at[:2], along.shape), at[:2] + RANGE_M * along), axis=1))
    met_m = shapely.distance(shapely.intersection(borders, rays), Point(at[:2]))
    is_hit = ~np.isnan(met_m)
    lengths = np.where(is_hit, met_m + noise, RANGE_M)
    return Scan(0.0, at, at[:2], at[:2] + lengths[:, None] * along, is_hit, np.full(len(ANGLES), 0.01))


class Robot:
    """known: what its map and others explain, beside the room."""

    def __init__(self, known: Sequence[BaseGeometry] = ()) -> None:
        self.known, self.is_informed = list(known), True
        self.perception = Perception(lambda: None, lambda: "L1", self._explains)
        self.now = 1000.0

    def _explains(self, floor: str, points: Floats, within_m: Floats) -> Floats:
        if not self.is_informed:
            raise NotReachable("no pool")
        with np.errstate(divide="ignore"):  # shapely finds the flag that a division in a kernel has left
            return shapely.distance(shapely.points(points), shapely.union_all([ROOM, *self.known])) <= within_m

    def look(self, scan: Scan | None, times: int = 1) -> Sequence[SeenThing]:
        for _ in range(times):
            self.now += STEP_S
            self.perception.update("L1", [scan] if scan else [], self.now)
        return self.perception.things


def test_a_thing_has_number_outline_and_age_and_goes_when_rays_pass() -> None:
    robot, chair = Robot(), box(6.5, 4.8, 7.0, 5.2)
    (thing,) = robot.look(scan_of([chair]), 10)
    assert (thing.number, thing.floor, thing.first_seen) == (1, "L1", pytest.approx(1000.2))
    assert thing.last_seen == pytest.approx(robot.now)
    assert 0.9 < thing.certainty < 1.0
    assert thing.at == pytest.approx((6.5, 5.0), abs=0.03)  # the side that it sees
    assert Polygon(thing.outline).hausdorff_distance(LineString([(6.5, 4.8), (6.5, 5.2)])) < 0.06
    for at in ((6.5, 2.5, 0.0), (8.5, 3.5, 0.0), (8.5, 5.0, 0.0)):
        (same,) = robot.look(scan_of([chair], at), 5)
    assert (same.number, same.first_seen) == (1, thing.first_seen)
    assert same.at == pytest.approx((6.75, 5.0), abs=0.03)
    assert robot.perception.obstacles.names == ("seen thing 1",)
    assert not robot.look(scan_of([]), 6)
    assert robot.perception.obstacles.forbidden_areas == ()
    (other,) = robot.look(scan_of([chair]), 2)
    assert other.number == 2


COORDINATES = st.floats(1.0, 9.0)
BOXES = st.tuples(COORDINATES, COORDINATES, st.floats(0.1, 1.0), st.floats(0.1, 1.0)).map(
    lambda given: box(given[0], given[1], given[0] + given[2], given[1] + given[3])
)
NOISE = st.integers(0, 1000).map(
    lambda seed: np.random.default_rng(seed).normal(0.0, 0.01, len(ANGLES)).clip(-0.03, 0.03)
)


def is_free(things: Sequence[BaseGeometry], at: Frame = AT) -> bool:
    return all(thing.distance(Point(at[:2])) > RADIUS_M for thing in things)


@settings(deadline=None, max_examples=8)
@given(st.lists(BOXES, max_size=3), st.lists(BOXES, max_size=3), NOISE)
def test_what_is_known_is_no_thing_and_what_rays_pass_goes(
    known: list[Polygon], unknown: list[Polygon], noise: Floats
) -> None:
    assume(is_free(known + unknown))
    robot = Robot(known)
    robot.look(scan_of(known, noise=noise), 5)
    assert robot.perception.things == ()
    things = robot.look(scan_of([*known, *unknown], noise=noise), 5)
    borders = shapely.union_all([ROOM, *(each.boundary for each in (*known, *unknown))])
    for thing in things:
        corners = shapely.points(thing.outline)
        assert shapely.distance(corners, shapely.union_all(unknown)).max() < 0.1  # noise, and half a cell's diagonal
        explained = shapely.union_all([ROOM, *known])
        assert Polygon(thing.outline).difference(explained.buffer(0.05)).area > 0.0
        assert borders.distance(Point(thing.at)) < 1.0
        assert 0.0 <= thing.certainty <= 1.0
        assert thing.first_seen <= thing.last_seen <= robot.now
    near = [each for each in unknown if AT_POINT.distance(each) < 4.0]
    visible = [each for each in near if len(near) == 1 and not known and ROOM.distance(each) > 0.3]
    assert len(things) >= len(visible)

    robot.known += unknown  # somebody puts them on the map
    assert not robot.look(scan_of([*known, *unknown], noise=noise))
    robot.known = list(known)
    robot.look(scan_of([*known, *unknown], noise=noise), 20)
    assert not robot.look(scan_of(known), 6)  # somebody takes them away


@settings(deadline=None, max_examples=8)
@given(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=60), st.integers(0, 1000))
def test_their_number_is_bounded_and_numbers_stay(spots: list[tuple[float, float]], seed: int) -> None:
    """Echoes anywhere, as many as there are rays, in each of some scans."""
    robot, choice = Robot(), np.random.default_rng(seed)
    first_seen: dict[int, float] = {}
    for _ in range(10):
        ends = np.repeat(np.array(spots), 100, axis=0) + choice.uniform(-0.5, 0.5, (100 * len(spots), 2))
        scan = Scan(0.0, AT, AT[:2], ends, np.ones(len(ends), bool), np.zeros(len(ends)))
        things = robot.look(scan)
        assert len(things) <= MAX_THINGS
        assert len(robot.perception._cells) <= MAX_CELLS
        assert len({thing.number for thing in things}) == len(things)
        for thing in things:
            assert first_seen.setdefault(thing.number, thing.first_seen) == thing.first_seen
            assert np.ptp(thing.outline, axis=0).max() < LARGEST_M + 0.1
            assert Polygon(thing.outline).is_valid
            assert Polygon(thing.outline).distance(AT_POINT) > RADIUS_M - 0.1 or len(thing.outline) > 4
    assert robot.perception.obstacles.names == tuple(f"seen thing {thing.number}" for thing in things)


def test_what_moves_leaves_no_trail() -> None:
    """It comes nearer, so that it hides where it was."""
    robot = Robot()
    for step in range(30):
        disc = Point(9.0 - 0.08 * step, 5.0).buffer(0.3)  # 0.4 m/s
        things = robot.look(scan_of([disc]))
        for thing in things:
            assert thing.last_seen > robot.now - 1.5
            assert max(disc.distance(Point(corner)) for corner in thing.outline) < 0.4 * 1.5 + 0.1
    assert 1 <= len(things) <= 2
    assert not robot.look(scan_of([]), 6)


def test_what_is_out_of_sight_times_out_and_an_uninformed_robot_changes_nothing() -> None:
    robot, told = Robot(), []
    robot.perception.subscribe(told.append)
    robot.look(scan_of([box(6.5, 4.8, 7.0, 5.2)]), 20)
    (thing,) = told[-1]
    robot.now += KEPT_S - 1.0
    assert robot.look(None)
    robot.is_informed = False
    with pytest.raises(NotReachable):
        robot.look(scan_of([]), 10)
    assert robot.perception.things[0].number == thing.number
    robot.now += 2.0
    assert not robot.look(None)
    robot.is_informed = True
    assert told[-1] == ()
    robot.look(scan_of([box(6.5, 4.8, 7.0, 5.2)]), 2)
    robot.perception.update("L2", [], robot.now)
    assert robot.perception.things == ()


def test_the_thread_reads_the_sensors_and_ends() -> None:
    """Its laser looks at a wall 2 m ahead that no map has."""
    ahead = np.minimum(2.0 / np.maximum(np.cos(LASER.angles), 1e-9), LASER.range_m)
    senses = Measured((RangeSensor("laser", Mount(), ScanSpec(LASER)), ahead))
    perception = Perception(lambda: senses, lambda: "L1", lambda floor, points, within_m: np.zeros(len(points), bool))
    perception.observe(RobotState(1.0, 3.0, 4.0, math.pi / 2))
    with pytest.raises(NotReachable, match="what its sensors see is unknown"):
        perception.check()
    perception.start()
    try:
        eventually(lambda: perception.things, 60.0, "that it sees the wall")
        perception.check()
    finally:
        perception.close()
    for thing in perception.things:
        assert thing.outline[:, 1] == pytest.approx(6.0, abs=0.06)
    assert perception.things[0].at == pytest.approx((3.0, 6.0), abs=1.0)
