"""What is in the way of a mission: how its pace follows, who steps aside where, and how they are asked."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from robocorba.errors.services import NotReachable
from robocorba.map_editor.model import Building, Door, Floor, Wall
from robocorba.missions import clearing
from robocorba.missions import lookout as module
from robocorba.missions.clearing import Requests, Way, in_the_way, place_aside, places_aside, united
from robocorba.missions.leader_policy import DEFAULT_POLICY, LeaderPolicy
from robocorba.missions.lookout import Lookout, Seen, WayAhead
from robocorba.missions.messages import MakeWay, WayMade
from robocorba.missions.obstacles import placed
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.world import StandingRobot
from robocorba.robot.kinematics.smartpal import RADIUS_M
from testkit.buildings import with_all

PATH = Trajectory([(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)])
NUMBERED = (("table", 7), ("chair", 8))
BODY = shapely.box(-0.5, -0.4, 0.5, 0.4)
GAP_M, LOOK_S, STOP_S = DEFAULT_POLICY.way_gap_m, DEFAULT_POLICY.look_ahead_s, DEFAULT_POLICY.stop_ahead_s


def robot(x: float, y: float, vx: float = 0.0, vy: float = 0.0, name: str = "r") -> Seen:
    return Seen(name, True, Point(x, y).buffer(0.3), vx, vy)


def looking_at(*seen: Seen) -> Lookout:
    return Lookout(PATH, BODY, {"A", "table"}, lambda: seen, DEFAULT_POLICY)


def test_what_stands_ahead_is_seen_in_time_and_what_is_beside_once_it_moves_there() -> None:
    lookout = looking_at(robot(3.0, 0.0))
    assert lookout.ahead(0.0) is None
    reached_s = next(t / 100 for t in range(2000) if PATH.at(t / 100)[0][0] >= 3.0 - 0.3 - 0.5 - GAP_M)
    assert lookout.ahead(reached_s - 3.0) == (robot(3.0, 0.0), pytest.approx(3.0, abs=0.3))
    assert lookout.ahead(reached_s - LOOK_S - 0.5) is None
    assert lookout.ahead(reached_s + 0.1) == (robot(3.0, 0.0), 0.0)
    assert looking_at(robot(2.0, 0.4 + 0.3 + 2 * GAP_M)).ahead(7.0) is None
    assert looking_at(robot(2.0, 0.4 + 0.3 - 0.01)).ahead(7.0) is not None
    beside = 0.4 + 0.3 + 0.5
    for speed, is_ahead in ((0.0, False), (-0.6, True), (0.6, False)):
        assert (looking_at(robot(1.5, beside, vy=speed)).ahead(4.0) is not None) is is_ahead


def test_the_team_is_not_in_its_own_way_and_known_under_other_names() -> None:
    table, chair = (Seen(name, False, Point(1.0, 0.0).buffer(0.3), 0.0, 0.0, number) for name, number in NUMBERED)
    seen = [table, robot(1.0, 0.0, name="A")]
    lookout = Lookout(PATH, BODY, {"A", "table"}, lambda: seen, DEFAULT_POLICY)
    assert lookout.ahead(4.0) is None
    seen[:] = [table._replace(name="L1/table")]
    assert lookout.ahead(4.0) is None
    seen.append(chair)
    assert lookout.ahead(4.0) is not None
    seen[:] = [chair._replace(name="table"), table._replace(name="stranger")]  # after a restart of the simulation
    found = lookout.ahead(4.0)
    assert found is not None and found[0].name == "stranger"


@given(x=st.floats(-2.0, 7.0), y=st.floats(-2.0, 2.0), begin_s=st.floats(0.0, PATH.duration))
@settings(max_examples=100, deadline=None)
def test_the_body_never_touches_what_it_has_not_seen(x: float, y: float, begin_s: float) -> None:
    seen = robot(x, y)
    if looking_at(seen).ahead(begin_s) is None:
        for number in range(41):
            pose = PATH.at(min(PATH.duration, begin_s + number / 40 * LOOK_S))[0]
            assert not placed(BODY, pose).intersects(seen.shape)


class Scene:
    """A way whose lookout sees `ahead`; the robots in it are asked to go to the origin."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.seen: tuple[Seen, float] | NotReachable | None = None
        self.now = 100.0
        self.asked: list[str] = []
        monkeypatch.setattr(module, "time", self)
        monkeypatch.setattr(module, "Background", _AtOnce)
        self.way = WayAhead(self, self._ask, DEFAULT_POLICY)  # type: ignore[arg-type]

    def monotonic(self) -> float:
        return self.now

    def ahead(self, trajectory_s: float) -> tuple[Seen, float] | None:
        if isinstance(self.seen, NotReachable):
            raise self.seen
        return self.seen

    def rate(self, seconds: float = 0.2) -> float:
        self.now += seconds
        return self.way.rate(0.0)

    def _ask(self, robot: str) -> Requests:
        self.asked.append(robot)
        transport: Any = SimpleNamespace(name="A", publish=lambda message: True)
        return Requests({robot: ("L1", 0.0, 0.0)}, "m.1", 1, transport, DEFAULT_POLICY)


class _AtOnce:
    def __init__(self, name: str, work: Callable[[], object], on_failure: Callable[[str], object]) -> None:
        self.start = work


def test_objects_are_not_asked_and_refusals_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(monkeypatch)
    scene.seen = robot(1.0, 1.0, name="chair")._replace(is_robot=False), 0.0
    assert scene.rate() == 0.0
    assert scene.asked == [] and scene.way.staying == ""
    scene.seen = robot(1.0, 1.0), 0.0
    assert scene.rate(5.0) == 0.0
    assert scene.way.waited_s == pytest.approx(5.0)  # for one after another
    scene.way.receive(WayMade(mission="m.1", robot="r", leader="A", reason="runs a program"))
    assert scene.way.staying == "runs a program"


def test_the_pace_follows_what_is_ahead_and_the_body_stops_once_that_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = Scene(monkeypatch)
    assert scene.rate() == 1.0
    scene.seen = robot(1.0, 1.0), STOP_S + 0.5
    assert scene.rate() == DEFAULT_POLICY.approach_rate
    assert scene.way.blocker is None
    scene.seen = robot(1.0, 1.0), STOP_S - 0.5
    assert scene.rate() == 0.0
    assert scene.way.blocker == robot(1.0, 1.0)
    assert scene.asked == ["r"]
    assert scene.rate(3.0) == 0.0
    assert scene.way.waited_s == pytest.approx(3.0)
    assert scene.asked == ["r"]
    scene.seen = None
    assert scene.rate(0.2) == 0.0  # it might come back
    assert scene.rate(0.5) == 1.0
    assert scene.way.blocker is None and scene.way.waited_s == 0.0
    scene = Scene(monkeypatch)
    assert scene.rate() == 1.0
    scene.seen = NotReachable("positions of other robots are unknown")
    assert scene.rate() == 1.0
    assert scene.rate(1.5) == 0.0
    assert scene.way.reason == "what is in the way is unknown"
    scene.seen = None
    scene.rate()
    assert scene.rate(1.0) == 1.0


# ---- who steps aside ----


WIDTH_M, HEIGHT_M = 12.0, 8.0


def hall(*walls: Wall | Door) -> Building:
    corners = ((0.0, 0.0), (WIDTH_M, 0.0), (WIDTH_M, HEIGHT_M), (0.0, HEIGHT_M))
    floor = Floor(name="L1", level=1, elevation=0.0, outline=corners)
    around = [Wall(f"w{number}", a, b) for number, (a, b) in enumerate(zip(corners, corners[1:] + corners[:1]))]  # noqa: B905
    return with_all(Building("hall"), [("", floor), *(("L1", each) for each in (*around, *walls))])


def at(name: str, x: float, y: float, floor: str = "L1") -> StandingRobot:
    return StandingRobot(name, floor, x, y, RADIUS_M)


def world(building: Building, *robots: StandingRobot) -> Any:
    """Without objects."""
    return SimpleNamespace(building=lambda: building, others=lambda carried: {}, robots=lambda: list(robots))


def strip(y: float, half_m: float = 0.8) -> Way:
    return {"L1": LineString([(1.0, y), (11.0, y)]).buffer(half_m)}


def test_robots_in_the_way_are_those_that_the_way_touches() -> None:
    way = strip(4.0)
    robots = [at("in", 5.0, 4.5), at("beside", 5.0, 4.85 + RADIUS_M + 0.01), at("above", 5.0, 4.0, "L2")]
    assert [robot.name for robot in in_the_way(way, robots)] == ["in"]
    assert [robot.name for robot in in_the_way(way, [at("near", 5.0, 4.8 + RADIUS_M + 0.04)])] == ["near"]


def test_robots_step_to_the_nearer_side_where_they_meet_nobody_and_keep_doors_free() -> None:
    place = place_aside(world(hall(), at("a", 5.0, 4.4)), strip(4.0), "a")
    assert place is not None and place.floor == "L1"
    assert 4.8 + RADIUS_M <= place.y <= 4.8 + RADIUS_M + clearing.ASIDE_GAP_M + 0.15
    assert abs(place.x - 5.0) < 0.3
    standing = [at("a", 5.0, 4.3), at("b", 5.0 + 2 * RADIUS_M + 0.05, 4.3), at("c", 5.0, 6.2)]
    a, b = places_aside(world(hall(), *standing), strip(4.0), standing[:2]).values()
    assert a and b
    assert math.dist(a[1:], b[1:]) >= 2 * RADIUS_M
    assert min(math.dist(place[1:], (5.0, 6.2)) for place in (a, b)) >= 2 * RADIUS_M
    building = hall(Wall("south", (0.0, 3.5), (12.0, 3.5)), Wall("north", (0.0, 5.0), (12.0, 5.0)))
    way = {"L1": shapely.box(0.0, 3.5, 12.0, 5.0)}
    assert places_aside(world(building, at("a", 5.0, 4.2)), way, [at("a", 5.0, 4.2)]) == {"a": None}
    door = Door("door", (5.0, 3.0), (6.4, 3.0))
    building = hall(Wall("left", (0.0, 3.0), (5.0, 3.0)), Wall("right", (6.4, 3.0), (12.0, 3.0)), door)
    way = {"L1": shapely.box(1.0, 3.3, 11.0, 5.0)}
    place = place_aside(world(building, at("a", 5.7, 3.6)), way, "a")
    assert place is not None
    assert LineString([door.a, door.b]).distance(Point(place.x, place.y)) >= clearing.DOOR_M + RADIUS_M


@given(
    x=st.floats(1.0, 11.0),
    y=st.floats(1.0, 7.0),
    turn=st.floats(0.0, math.pi),
    half_m=st.floats(0.3, 2.0),
    others=st.lists(st.tuples(st.floats(0.5, 11.5), st.floats(0.5, 7.5)), max_size=6),
)
@settings(max_examples=20, deadline=None)
def test_places_are_free_and_outside_the_way(
    x: float, y: float, turn: float, half_m: float, others: list[tuple[float, float]]
) -> None:
    robot = at("a", x, y)
    standing = [at(f"o{number}", *place) for number, place in enumerate(others)]
    standing = [other for other in standing if math.dist((other.x, other.y), (x, y)) > 2 * RADIUS_M]
    dx, dy = 3.0 * math.cos(turn), 3.0 * math.sin(turn)
    way = {"L1": LineString([(x - dx, y - dy), (x + dx, y + dy)]).buffer(half_m)}
    place = place_aside(world(hall(), robot, *standing), way, "a")
    if place is None:
        return
    there = Point(place.x, place.y)
    assert way["L1"].distance(there) >= RADIUS_M + clearing.GAP_M - 1e-6
    assert RADIUS_M <= place.x <= WIDTH_M - RADIUS_M and RADIUS_M <= place.y <= HEIGHT_M - RADIUS_M
    assert all(math.dist((other.x, other.y), (place.x, place.y)) >= 2 * RADIUS_M - 0.02 for other in standing)


def test_areas_of_a_floor_are_united() -> None:
    found = united([("L1", shapely.box(0, 0, 1, 1)), ("L2", shapely.box(0, 0, 1, 1)), ("L1", shapely.box(1, 0, 2, 1))])
    assert {floor: area.area for floor, area in found.items()} == pytest.approx({"L1": 2.0, "L2": 1.0})


# ---- requests ----


STUCK = {"stuck": "has no room to step aside"}


def asked(policy: LeaderPolicy, *names: str) -> tuple[Requests, list[MakeWay]]:
    sent: list[MakeWay] = []
    transport: Any = SimpleNamespace(name="A", publish=sent.append)
    aside = dict.fromkeys(names, ("L1", 1.0, 2.0))
    return Requests({**aside, "stuck": None}, "m.1", 3, transport, policy), sent


def said(robot: str, is_done: bool = False, reason: str = "", mission: str = "m.1") -> WayMade:
    return WayMade(mission=mission, robot=robot, leader="A", is_done=is_done, reason=reason)


def test_requests_are_repeated_until_the_robot_is_there() -> None:
    requests, sent = asked(LeaderPolicy(repeat_interval_s=0.0), "B")
    requests.update()
    requests.receive(said("B"))
    requests.update()
    assert [(each.robot, each.x, each.y, each.leader, each.term) for each in sent] == [("B", 1.0, 2.0, "A", 3)] * 2
    assert requests.robots == ("B",)
    requests.receive(said("B", is_done=True, mission="m.0"))  # of an earlier attempt
    requests.receive(said("C", is_done=True))
    assert requests.robots == ("B",)
    requests.receive(said("B", is_done=True))
    assert requests.robots == ()
    requests.update()
    assert len(sent) == 2
    assert requests.staying == STUCK


@pytest.mark.parametrize(
    ("policy", "left", "late"),
    [
        (LeaderPolicy(), ("C", "D"), {}),
        (LeaderPolicy(aside_answer_timeout_s=0.0), ("C",), {"D": "does not answer"}),
        (LeaderPolicy(aside_timeout_s=0.0), (), dict.fromkeys("CD", "did not step aside within 0 s")),
    ],
)
def test_robots_that_stay_are_named_with_their_reasons(
    policy: LeaderPolicy, left: tuple[str, ...], late: dict[str, str]
) -> None:
    requests, _ = asked(policy, "B", "C", "D")
    requests.receive(said("B", reason="runs a program"))
    requests.receive(said("C"))
    requests.update()
    assert requests.robots == left
    assert requests.staying == {**STUCK, "B": "runs a program", **late}
