"""Formations of robots around an object that they carry."""

from __future__ import annotations

import math
from itertools import combinations

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPoint, Point, Polygon

from robocorba.errors.robots import InvalidCarry
from robocorba.map_editor.model import CircleShape, MapObject
from robocorba.map_editor.movable import object_outline
from robocorba.missions.formation import (
    HAND_M,
    MAX_OFFSET_M,
    MAX_OFFSET_ONE_GRIP_M,
    Formation,
    GripPoint,
    formations,
)
from robocorba.robot.kinematics.smartpal import RADIUS_M

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


@settings(max_examples=40, deadline=None)
@given(outlines(), st.integers(1, 6))
def test_carriers_do_not_overlap_and_hold_the_object_around_its_centroid(outline: Polygon, count: int) -> None:
    try:
        found = formations(outline, count)
    except InvalidCarry:
        return
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


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
def test_up_to_six_robots_have_formations_around_a_table(count: int) -> None:
    found = formations(TABLE, count)
    assert found == formations(TABLE, count)
    assert len({tuple(sorted(formation.grips)) for formation in found}) == len(found)


def test_two_take_a_table_at_its_ends() -> None:
    places = sorted(formations(TABLE, 2)[0].carrier_poses())
    assert places[0] == pytest.approx((-1.42, 0.0, 0.0))
    assert places[1][:2] == pytest.approx((1.42, 0.0))


def test_four_take_a_round_table_from_all_sides() -> None:
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
    with pytest.raises(InvalidCarry):
        formations(outline, count)


@settings(max_examples=40, deadline=None)
@given(outlines(), st.integers(1, 6), st.floats(0.5, 20.0))
def test_groups_that_are_enough_can_carry_and_hold_the_object(outline: Polygon, count: int, mass_kg: float) -> None:
    try:
        formation = formations(outline, count)[0]
    except InvalidCarry:
        return
    groups = formation.enough(outline, mass_kg, 4.0)
    for group in groups:
        assert len(group) < count
        assert 4.0 * len(group) >= mass_kg - 1e-6
        points = MultiPoint([formation.grips[number][:2] for number in group]).convex_hull
        assert points.distance(outline.centroid) <= (MAX_OFFSET_ONE_GRIP_M if len(group) == 1 else MAX_OFFSET_M)
        assert not any(set(other) < set(group) for other in groups)


@pytest.mark.parametrize(
    ("mass_kg", "enough"),
    [(3.0, [(0,), (1,), (2,)]), (7.0, [(0, 1)]), (9.0, [])],
)
def test_how_many_carriers_are_enough(mass_kg: float, enough: list[tuple[int, ...]]) -> None:
    """One at each end of a box, and one beside it whose line to either end passes far from the centroid."""
    grips = GripPoint(-0.5, 0.0, 0.0), GripPoint(0.5, 0.0, math.pi), GripPoint(0.0, 0.5, -math.pi / 2)
    assert Formation(grips).enough(shapely.box(-0.5, -0.5, 0.5, 0.5), mass_kg, 4.0) == enough


@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3)), min_size=1, max_size=4))
def test_a_formation_is_known_by_its_carriers(poses: list[tuple[float, float, float]]) -> None:
    found = Formation.of_carriers(poses).carrier_poses()
    assert [value for pose in found for value in pose] == pytest.approx([value for pose in poses for value in pose])
