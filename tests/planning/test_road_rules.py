"""What each mode makes of the rules of edges."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robocorba.errors.paths import NoPath
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from robocorba.planning.road_rules import breaks_rule, limits_along, make_lanes, slowed_length, tie_lanes
from tests.planning.every_request import judged
from tests.planning.scenes import edge, node, room, ruled_building

A, B = Place("L1", 2.0, 5.0), Place("L1", 18.0, 5.0)


def one_lane(**rules: object) -> np.ndarray:
    return make_lanes([edge("a", "b", **rules)], np.array([[0, 1]]), np.array([[0.0, 0.0], [5.0, 0.0]]))


@pytest.mark.parametrize(
    ("line", "along", "against"),
    [
        ((0.0, 0.0, 5.0, 0.0), True, False),
        ((5.0, 0.0, 0.0, 0.0), True, True),
        ((5.0, 0.3, 0.0, 0.3), True, True),  # beside
        ((5.0, 1.0, 0.0, 1.0), False, False),  # farther than the radius
        ((2.5, -2.0, 2.5, 2.0), False, False),  # across
        ((2.7, -2.0, 2.5, 2.0), False, False),  # across, a little backwards
        ((0.5, 0.0, 0.0, 0.0), False, False),  # shorter than the robot
    ],
)
def test_what_follows_an_edge(line: tuple[float, ...], along: bool, against: bool) -> None:
    assert breaks_rule(one_lane(clearance=0.2), *line, 0.4) == along
    assert breaks_rule(one_lane(one_way=True), *line, 0.4) == against
    assert not breaks_rule(one_lane(clearance=0.4), *line, 0.4)
    assert not breaks_rule(one_lane(speed_limit=0.1), *line, 0.4)


def test_only_drives_that_connect_a_place_must_not_cross_a_closed_edge() -> None:
    across = (2.5, -2.0, 2.5, 2.0)
    lanes = one_lane(clearance=0.2)
    assert not breaks_rule(lanes, *across, 0.4)
    assert breaks_rule(tie_lanes(lanes, 2.5, -2.0, 0.4), *across, 0.4)
    assert not breaks_rule(tie_lanes(lanes, 2.5, -0.3, 0.4), 2.5, -0.3, 2.5, 2.0, 0.4)  # the robot stands on it
    one_way = one_lane(one_way=True)
    assert not breaks_rule(tie_lanes(one_way, 2.5, -2.0, 0.4), *across, 0.4)


def test_a_drive_is_slow_where_it_follows_a_speed_limit() -> None:
    lanes = one_lane(speed_limit=0.2)
    ends, limits = limits_along(lanes, -5.0, 0.0, 15.0, 0.0, 0.4)
    assert (ends.tolist(), limits.tolist()) == ([0.25, 0.5, 1.0], [math.inf, 0.2, math.inf])
    assert slowed_length(lanes, np.array([[-5.0, 0.0], [15.0, 0.0]]), 0.4, 1.0) == pytest.approx(15.0 + 5.0 / 0.2)
    for begin in (0.0, 1e-12, -1e-12):
        ends, limits = limits_along(lanes, begin, 0.0, 10.0, 0.0, 0.4)
        assert (ends.tolist(), limits.tolist()) == (pytest.approx([0.5, 1.0]), [0.2, math.inf])


def test_of_two_edges_between_two_nodes_the_more_permissive_one_counts() -> None:
    edges = [edge("a", "b", one_way=True, graphs=("g",)), edge("b", "a", one_way=True, speed_limit=0.5)]
    ends, xy = np.array([[0, 1], [1, 0]]), np.array([[0.0, 0.0], [5.0, 0.0]])
    for graph, is_closed in (("", False), ("g", False), ("h", True)):
        lanes = make_lanes(edges, ends, xy, graph)
        assert breaks_rule(lanes, 0.0, 0.0, 5.0, 0.0, 0.4) == is_closed
        assert not breaks_rule(lanes, 5.0, 0.0, 0.0, 0.0, 0.4)
    assert slowed_length(lanes, np.array([[5.0, 0.0], [0.0, 0.0]]), 0.4, 1.0) == pytest.approx(10.0)


@pytest.mark.parametrize("best", Criterion)
def test_speed_limits_hold_wherever_a_drive_follows_the_edge(best: Criterion) -> None:
    nodes = [node("a", 2, 5), node("b", 8, 5), node("c", 12, 5), node("d", 18, 5)]
    slow = [edge("a", "b"), edge("b", "c", speed_limit=0.2), edge("c", "d")]
    planner = PathPlanner(room(20.0, 10.0, *nodes, *slow))
    beside = planner.paths(PathRequest(Place("L1", 2.5, 5.3), Place("L1", 17.5, 5.3), best=best))[0]
    is_fastest = best is Criterion.SHORTEST_TIME
    assert beside.duration == pytest.approx(31.0, abs=0.2)
    assert beside.distance == pytest.approx(15.0, abs=0.3 if is_fastest else 1e-9)
    tie = planner.paths(PathRequest(Place("L1", 9.0, 5.0), B, best=best, mode=RouteMode.TOPOLOGICAL))[0]
    assert tie.duration == pytest.approx(3.0 / 0.2 + 6.0)


def test_a_robot_too_large_for_an_edge_drives_beside_it_or_not_at_all() -> None:
    planner = PathPlanner(room(20.0, 10.0, node("a", 2, 5), node("b", 18, 5), edge("a", "b", clearance=0.2)))
    with pytest.raises(NoPath, match=r"'a-b' on L1: is for robots of at most 0\.2 m"):
        planner.paths(PathRequest(A, B, mode=RouteMode.TOPOLOGICAL))
    assert planner.shortest(A, B).distance == pytest.approx(16.46, abs=0.01)
    assert planner.paths(PathRequest(A, B, radius=0.2))[0].distance == pytest.approx(16.0)


@pytest.mark.parametrize("seed", range(12))
def test_the_judge_has_no_objection(seed: int) -> None:
    answers = judged(ruled_building(seed), 25, seed)
    wrong = [f"{request}: {verdict}" for request, verdict in answers if verdict.objections]
    assert not wrong, "\n".join(wrong[:3])
