"""Carried bodies: formations around them, their trajectories, and the areas that they sweep."""

from __future__ import annotations

import math
from itertools import combinations

import msgpack
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPoint, Point, Polygon

from robocorba.errors.robots import InvalidPlan
from robocorba.map_editor.model import CircleShape, MapObject
from robocorba.map_editor.movable import object_outline
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import Limits, Pose2D
from robocorba.missions.carry_planning import CarryLeg, CarryPlan
from robocorba.missions.formation import (
    BACK_OFF_M,
    HAND_M,
    MAX_OFFSET_M,
    MAX_OFFSET_ONE_GRIP_M,
    Formation,
    GripPoint,
    formations,
)
from robocorba.missions.obstacles import placed
from robocorba.missions.swept_area import swept_areas
from robocorba.missions.trajectory import Trajectory
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.simulation.reservations import MAX_CORNERS

TABLE = shapely.box(-0.8, -0.4, 0.8, 0.4)


def circle(radius_m: float) -> Polygon:
    return object_outline(MapObject(name="round", shape=CircleShape(radius=radius_m), at=(0.0, 0.0)))


@st.composite
def outlines(draw: st.DrawFn) -> Polygon:
    kind = draw(st.sampled_from(("box", "circle", "polygon")))
    if kind == "box":
        width, depth = draw(st.floats(0.2, 3.0)), draw(st.floats(0.2, 3.0))
        return shapely.box(-width / 2, -depth / 2, width / 2, depth / 2)
    if kind == "circle":
        return circle(draw(st.floats(0.1, 1.5)))
    sides = draw(st.integers(3, 7))
    ends = [draw(st.floats(0.3, 1.5)) for _ in range(sides)]
    turns = [math.tau * i / sides for i in range(sides)]
    return Polygon([(end * math.cos(turn), end * math.sin(turn)) for end, turn in zip(ends, turns, strict=True)])


@settings(max_examples=20, deadline=None)
@given(outlines() | st.just(TABLE), st.integers(1, 6))
def test_carriers_do_not_overlap_and_hold_the_object_around_its_centroid(outline: Polygon, count: int) -> None:
    try:
        found = formations(outline, count)
    except InvalidPlan:
        assert outline is not TABLE
        return
    assert found == formations(outline, count)
    assert len({tuple(sorted(formation.grips)) for formation in found}) == len(found)
    for formation in found:
        places = formation.carrier_poses()
        assert len(places) == count
        for here, there in combinations(places, 2):
            assert math.dist(here[:2], there[:2]) > 2 * RADIUS_M
        for (x, y, heading), grip in zip(places, formation.grips, strict=True):
            assert outline.distance(Point(x, y)) >= RADIUS_M
            hands = x + HAND_M * math.cos(heading), y + HAND_M * math.sin(heading)
            assert hands == pytest.approx(grip[:2])
            assert outline.exterior.distance(Point(grip[:2])) < 1e-6
        held = MultiPoint([grip[:2] for grip in formation.grips]).convex_hull
        assert count == 1 or held.distance(outline.centroid) <= MAX_OFFSET_M


def test_two_take_a_table_at_its_ends_and_four_a_round_table_from_all_sides() -> None:
    places = sorted(formations(TABLE, 2)[0].carrier_poses())
    assert places[0] == pytest.approx((-1.42, 0.0, 0.0))
    assert places[1][:2] == pytest.approx((1.42, 0.0))
    hull = MultiPoint([grip[:2] for grip in formations(circle(0.6), 4)[0].grips]).convex_hull
    assert hull.exterior.distance(Point(0.0, 0.0)) > 0.25


def test_a_footprint_has_the_object_its_carriers_and_their_arms() -> None:
    formation = Formation((GripPoint(0.8, 0.0, math.pi), GripPoint(-0.8, 0.0, 0.0)))
    footprint = formation.footprint(TABLE)
    assert footprint.geom_type == "Polygon"
    assert footprint.bounds == pytest.approx((-1.82, -0.4, 1.82, 0.4))
    assert footprint.covers(TABLE)
    assert footprint.area == pytest.approx(1.6 * 0.8 + 2 * math.pi * 0.16 + 2 * 0.4 * 0.22, abs=0.04)


@pytest.mark.parametrize(
    ("outline", "count"), [(TABLE, 0), (TABLE, 7), (shapely.box(-0.1, -0.1, 0.1, 0.1), 6), (Polygon(), 2)]
)
def test_impossible_formations_are_refused(outline: Polygon, count: int) -> None:
    with pytest.raises(InvalidPlan):
        formations(outline, count)


@settings(max_examples=20, deadline=None)
@given(outlines(), st.integers(1, 6), st.floats(0.5, 20.0))
def test_groups_that_are_enough_can_carry_and_hold_the_object(outline: Polygon, count: int, mass_kg: float) -> None:
    try:
        formation = formations(outline, count)[0]
    except InvalidPlan:
        return
    groups = formation.enough(outline, mass_kg, 4.0)
    for group in groups:
        assert len(group) < count
        assert 4.0 * len(group) >= mass_kg - 1e-6
        points = MultiPoint([formation.grips[number][:2] for number in group]).convex_hull
        assert points.distance(outline.centroid) <= (MAX_OFFSET_ONE_GRIP_M if len(group) == 1 else MAX_OFFSET_M)
        assert not any(set(other) < set(group) for other in groups)


@pytest.mark.parametrize(("mass_kg", "enough"), [(3.0, [(0,), (1,), (2,)]), (7.0, [(0, 1)]), (9.0, [])])
def test_how_many_carriers_are_enough(mass_kg: float, enough: list[tuple[int, ...]]) -> None:
    """One at each end of a box, and one beside it whose line to either end passes far from the centroid."""
    grips = GripPoint(-0.5, 0.0, 0.0), GripPoint(0.5, 0.0, math.pi), GripPoint(0.0, 0.5, -math.pi / 2)
    assert Formation(grips).enough(shapely.box(-0.5, -0.5, 0.5, 0.5), mass_kg, 4.0) == enough


@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3)), min_size=1, max_size=4))
def test_a_formation_is_known_by_its_carriers(poses: list[Pose2D]) -> None:
    found = Formation.of_carriers(poses).carrier_poses()
    assert [value for pose in found for value in pose] == pytest.approx([value for pose in poses for value in pose])


PLACES = ((-1.42, 0.0, 0.0), (1.42, 0.0, math.pi), (0.4, 1.02, -math.pi / 2))
poses = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-7, 7)), min_size=1, max_size=6)
limits = st.builds(Limits, st.floats(0.05, 1.0), st.floats(0.1, 1.0), st.floats(0.1, 1.0))


@settings(max_examples=8, deadline=None)
@given(poses, limits)
def test_no_carrier_exceeds_the_limits(path: list[Pose2D], limits: Limits) -> None:
    speed, turn_speed, acceleration, _ = limits
    trajectory = Trajectory(path, PLACES, limits)
    times = np.linspace(0.0, trajectory.duration, 400)
    step = 1e-4
    for place in (*PLACES, (0.0, 0.0, 0.0)):
        for t in times:
            _, (vx, vy, turn) = trajectory.carrier(t, place)
            assert math.hypot(vx, vy) <= speed * (1 + 1e-9)
            assert abs(turn) <= turn_speed * (1 + 1e-9)
            _, (wx, wy, _) = trajectory.carrier(t + step, place)
            assert math.hypot(wx - vx, wy - vy) / step <= acceleration * 1.01 + 1e-6


@settings(max_examples=8, deadline=None)
@given(poses)
def test_the_body_stops_at_each_pose_also_of_a_transmitted_trajectory(path: list[Pose2D]) -> None:
    trajectory, step = Trajectory(path, PLACES), 1e-5
    for t in np.linspace(0.0, trajectory.duration, 100)[1:-1]:
        before, _ = trajectory.carrier(t - step, PLACES[2])
        after, _ = trajectory.carrier(t + step, PLACES[2])
        _, velocity = trajectory.carrier(t, PLACES[2])
        assert (np.subtract(after, before) / (2 * step)).tolist() == pytest.approx(velocity, abs=1e-3)
    received = Trajectory.from_rows(msgpack.unpackb(msgpack.packb(trajectory.to_rows())))
    assert received.to_rows() == trajectory.to_rows()
    assert received.duration == trajectory.duration
    for t in np.linspace(-1.0, trajectory.duration + 1.0, 50).tolist():
        assert received.at(t) == trajectory.at(t)
    assert trajectory.at(-1.0)[0] == trajectory.start
    assert trajectory.start == pytest.approx(path[0], abs=1e-6)
    assert trajectory.at(trajectory.duration) == (path[-1], (0.0, 0.0, 0.0))
    for begins, x, y, heading, _ in trajectory.to_rows():
        pose, velocity = trajectory.at(begins)
        assert pose == pytest.approx((x, y, heading), abs=1e-9)
        assert velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_four_metres_straight_and_a_turn_on_the_spot() -> None:
    trajectory = Trajectory([(0, 0, 0), (4, 0, 0)], PLACES)
    ramp_s = 1.5 * 0.25 / 0.4
    assert trajectory.duration == pytest.approx(16.0 + ramp_s)
    (x, _, _), (vx, _, _) = trajectory.at(trajectory.duration / 2)
    assert (x, vx) == pytest.approx((2.0, 0.25))
    trajectory = Trajectory([(1, 2, 0), (1, 2, math.pi / 2)], PLACES[:2])
    (x, y, heading), velocity = trajectory.carrier(trajectory.duration, PLACES[0])
    assert (x, y, heading) == pytest.approx((1.0, 0.58, math.pi / 2))
    assert velocity == (0.0, 0.0, 0.0)
    standing = Trajectory([(1, 2, 3), (1, 2, 3)], PLACES)
    assert standing.duration == 0.0
    assert standing.at(5.0) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [(0.0, 0.0, 0.0, 0.0, 0.0)] * 2001,
        [(0.0, 1.0, 2.0)],
        [(0.0, 0.0, 0.0, math.nan, 0.0)],
        [(0.0, 0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0, 0.0)],
        [(0.0, 0.0, 0.0, 0.0, 0.0), (2.0, 1.0, 0.0, 0.0, 0.0)],
        [(0.0, 0.0, 0.0, 0.0, 1.5), (2.0, 1.0, 0.0, 0.0, 0.0)],
    ],
)
def test_invalid_rows_are_refused(rows: list[tuple[float, ...]]) -> None:
    with pytest.raises(InvalidPlan):
        Trajectory.from_rows(rows)


FORMATION = formations(TABLE, 3)[0]


def areas_of(*legs: CarryLeg) -> tuple[FloorArea, ...]:
    return swept_areas(CarryPlan(FORMATION, legs, TABLE))


@settings(deadline=None, max_examples=25)
@given(
    st.lists(st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3, 3)), min_size=1, max_size=6), st.floats(0, 1)
)
def test_the_body_stays_within_the_swept_area(poses: list[Pose2D], share: float) -> None:
    ((floor, corners),) = areas_of(CarryLeg("L1", np.array(poses), ""))
    area = Polygon(corners)
    assert floor == "L1"
    assert area.is_valid
    assert len(corners) * 5 <= MAX_CORNERS
    at = share * (len(poses) - 1)
    before, after = poses[int(at)], poses[min(int(at) + 1, len(poses) - 1)]
    x, y, heading = (a + (at - int(at)) * (b - a) for a, b in zip(before, after, strict=True))
    assert area.buffer(0.03).covers(placed(FORMATION.footprint(TABLE), (x, y, heading)))


def test_the_swept_area_holds_the_gathering_and_little_more() -> None:
    gathered = FORMATION.footprint(TABLE, BACK_OFF_M)
    path = np.array([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
    (area,) = (Polygon(corners) for _, corners in areas_of(CarryLeg("L1", path, "")))
    for end in path.tolist():
        assert area.covers(placed(gathered, (end[0], end[1], end[2])))
    passed = shapely.union_all([placed(gathered, (x, 0.0, 0.0)) for x in np.linspace(0, 6, 60)])
    assert area.area < 1.25 * passed.convex_hull.area
    assert area.distance(shapely.Point(3.0, 2.5)) > 0.5
