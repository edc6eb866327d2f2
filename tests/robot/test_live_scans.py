"""Scans for viewers: who is asked for them and when, what no map has, and what is nearest."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot import live_scans
from robocorba.robot.live_scans import (
    AGAIN_S,
    RAYS_AROUND,
    ROBOTS_AT_ONCE,
    LiveScans,
    SensedRobot,
    nearest,
    robots_on,
    unmapped,
)
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.noise import disturb
from robocorba.simulation.sensing.scan import LASER, PROXIMITY, Mount, Noise, ScanResult, ScanSpec, robot_scan
from robocorba.simulation.sensing.virtual_sensor import scan_from
from robocorba.simulation.sensing.visible_obstacles import NO_ROBOT, VisibleObstacles
from testkit.processes import eventually
from tests.clock import Clock
from tests.simulation.places import scan

#: Kinds of sensors that a robot may have at a moment.
VIRTUAL, OWN, NONE, BROKEN = "virtual", "own", "none", "broken"


def sensed(name: str, time: float = 7.0) -> SensedRobot:
    return SensedRobot(name, Pose("L1", 1.0, 2.0, 0.0), 0.4, time)


class Robots:
    """Robots with sensors of these kinds, what they are asked, and the live scans of them."""

    def __init__(self, **kinds: str) -> None:
        self.kinds, self.clock = kinds, Clock()
        self.asked, self.scanned = list[str](), list[str]()
        self.are_servers_away = False
        self.scans = LiveScans(self.own, self.virtual, self.clock)

    def own(self, name: str) -> list[RobotScan] | None:
        self.asked.append(name)
        kind = self.kinds[name]
        if kind == BROKEN:
            raise AdaptorFailed("its sensor is frozen")
        own = scan(name, 99.0, distances=np.array([8.0, 8.0, 2.0, 8.0, 8.0]), hits=np.arange(5) == 2, is_virtual=False)
        return {VIRTUAL: None, NONE: [], OWN: [own]}[kind]

    def virtual(
        self, robots: Sequence[tuple[str, Pose]], time_s: float, spec: ScanSpec, mount: Mount
    ) -> list[RobotScan]:
        if spec.fan is LASER:
            self.scanned += [name for name, _ in robots]
        if self.are_servers_away:
            raise NotReachable("the virtual sensor servers")
        count = spec.fan.count
        result = ScanResult(time_s, np.zeros((1, 3)), np.full((1, count), spec.fan.range_m))
        return [robot_scan(name, at, mount, spec, result) for name, at in robots]

    def read(self, time: float = 7.0) -> dict[str, list[RobotScan]]:
        """What is seen of all robots at a simulated time [s]."""
        found: dict[str, list[RobotScan]] = {name: [] for name in self.kinds}
        self.asked, self.scanned = [], []
        for each in self.scans.read([sensed(name, time) for name in self.kinds]):
            found[each.robot].append(each)
        return found


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Readers wait until all have answered."""
    monkeypatch.setattr(live_scans, "ANSWER_LIMIT_S", 60.0)


@contextlib.contextmanager
def robots(**kinds: str) -> Iterator[Robots]:
    found = Robots(**kinds)
    with contextlib.closing(found.scans):
        yield found


@pytest.mark.usefixtures("patient")
def test_own_scans_are_compared_with_the_map_and_virtual_ones_have_a_rim() -> None:
    with robots(A=OWN, V=VIRTUAL) as place:
        place.read()
        found = place.read(7.1)
        (own,) = found["A"]
        assert (own.time, own.is_virtual, np.flatnonzero(own.unmapped).tolist()) == (7.1, False, [2])
        assert [(each.time, each.is_virtual, each.rim_m) for each in found["V"]] == [(7.1, True, 0.0), (7.1, True, 0.4)]
        place.are_servers_away = True
        found = place.read()
        assert [(each.hits.sum(), len(each.unmapped)) for each in found["A"]] == [(1, 0)]  # not compared
        assert found["V"] == []


@pytest.mark.usefixtures("patient")
def test_many_robots_take_turns() -> None:
    names = [f"R{number}" for number in range(2 * ROBOTS_AT_ONCE + 1)]
    for kind in (OWN, VIRTUAL):
        with robots(**dict.fromkeys(names, kind)) as place:
            for _ in range(3):
                place.read()
            turns = []
            for _ in range(6):
                place.clock.now += 0.1
                place.read()
                turns.append(len(place.asked if kind == OWN else place.scanned))
                place.asked, place.scanned = [], []
            assert turns == [ROBOTS_AT_ONCE] * 6
            found = place.read()
            assert all(found.values())
            for _ in range(4):  # those at which somebody looks have each turn
                asked = place.asked if kind == OWN else place.scanned
                place.clock.now += 0.1
                asked.clear()
                place.scans.read([sensed(name) for name in names], first=names[:3])
                assert len(asked) == ROBOTS_AT_ONCE and set(names[:3]) < set(asked)


def test_one_that_hangs_delays_no_other_and_is_not_asked_again_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    with robots(A=OWN, H=OWN) as place:
        may_answer, own, begun = threading.Event(), place.own, list[str]()

        def slow(name: str) -> list[RobotScan] | None:
            begun.append(name)
            if name == "H":
                may_answer.wait(60.0)
            return own(name)

        monkeypatch.setattr(place.scans, "_own", slow)
        eventually(lambda: place.read()["A"], 60.0, "A's scan")
        count = begun.count("A")
        eventually(lambda: (place.read(), begun.count("A") > count + 3)[1], 60.0, "more scans of A")
        assert begun.count("H") == 1
        may_answer.set()
        eventually(lambda: place.read()["H"], 60.0, "H's scan")


class Kinds(RuleBasedStateMachine):
    """Robots come, go, fail and change what they are connected with. The model: what is known of each, and when it is
    asked again."""

    def __init__(self) -> None:
        super().__init__()
        self.place = Robots()
        #: By name: the kind that is known, empty for none, and the time from which it is asked again [s].
        self.known: dict[str, tuple[str, float]] = {}

    def teardown(self) -> None:
        self.place.scans.close()

    @rule(name=st.sampled_from("ABC"), kind=st.sampled_from((VIRTUAL, OWN, NONE, BROKEN)))
    def change(self, name: str, kind: str) -> None:
        self.place.kinds[name] = kind

    @precondition(lambda self: self.place.kinds)
    @rule(data=st.data())
    def leave(self, data: st.DataObject) -> None:
        del self.place.kinds[data.draw(st.sampled_from(sorted(self.place.kinds)))]

    @rule(seconds=st.sampled_from((0.1, AGAIN_S / 2, AGAIN_S)))
    def wait(self, seconds: float) -> None:
        self.place.clock.now += seconds

    @rule()
    def read(self) -> None:
        now, kinds = self.place.clock.now, self.place.kinds
        self.known = {name: self.known.get(name, ("", 0.0)) for name in kinds}
        due = sorted(name for name, (_, again_at) in self.known.items() if now >= again_at)
        virtual = sorted(name for name, (kind, _) in self.known.items() if kind == VIRTUAL)
        found = self.place.read()
        assert (sorted(self.place.asked), sorted(self.place.scanned)) == (due, virtual)
        for name in due:
            # A virtual robot whose agent does not answer stays one.
            kind = VIRTUAL if kinds[name] == BROKEN and self.known[name][0] == VIRTUAL else kinds[name]
            self.known[name] = kind, now + (0.0 if kind == OWN else AGAIN_S)
        for name, (kind, _) in self.known.items():
            expected = {OWN: 1, VIRTUAL: 2 if name in virtual else 0}.get(kind, 0)
            assert [each.is_virtual for each in found[name]] == [kind == VIRTUAL] * expected, (name, kind)


@pytest.mark.usefixtures("patient")
class TestKinds(Kinds.TestCase):  # type: ignore[name-defined,misc]
    settings = settings(max_examples=30, stateful_step_count=25, deadline=None)


ROOM = shapely.box(0.0, 0.0, 8.0, 6.0).exterior
PILLAR, CHAIR = shapely.box(3.0, 4.0, 3.4, 4.4), shapely.box(4.5, 2.75, 5.0, 3.25)
SPARSE = Fan(-math.pi, math.pi / 12, 24, 8.0)


def distances(shapes: Sequence[Any], at: tuple[float, float, float], spec: ScanSpec) -> Floats:
    *_, found = scan_from(VisibleObstacles(shapes).grids, np.array([at]), Mount(), NO_ROBOT, spec.fan.rays, spec.frame)
    return np.asarray(found[0])


@given(
    st.sampled_from((LASER, PROXIMITY, SPARSE)),
    st.tuples(st.floats(1.0, 7.0), st.floats(0.7, 3.0), st.floats(-math.pi, math.pi)),
    st.tuples(*[st.floats(-0.05, 0.05)] * 2, st.floats(-0.01, 0.01)),
    st.sampled_from((Noise(), Noise(0.01, 0.005, 0.1))),
    st.booleans(),
    st.integers(0, 1000),
)
@settings(max_examples=50, deadline=None)
def test_a_ray_is_marked_where_it_ends_before_all_that_is_known(
    fan: Fan,
    at: tuple[float, float, float],
    error: tuple[float, float, float],
    noise: Noise,
    has_chair: bool,
    seed: int,
) -> None:
    """Never for an error of place, heading or distance; always for a chair that stands free."""
    spec = ScanSpec(fan, 0.4 if fan is PROXIMITY else 0.0, noise, seed)
    known = [ROOM, PILLAR]
    if CHAIR.distance(shapely.Point(at[:2])) < 0.5:
        return
    believed = (at[0] + error[0], at[1] + error[1], at[2] + error[2])
    around = distances(known, believed, ScanSpec(Fan(0.0, math.tau / RAYS_AROUND, RAYS_AROUND, 8.4)))
    bare, measured = distances(known, at, spec), distances([*known, CHAIR] if has_chair else known, at, spec)
    seen = disturb(noise, measured[None], fan.range_m, seed, np.zeros(1, np.int64))[0] if noise else measured
    result = ScanResult(1.0, np.array([at]), seen[None])
    found = unmapped(robot_scan("A", Pose("L1", *believed), Mount(), spec, result), around)
    is_chair = measured < bare - 1e-6
    assert not found[~is_chair].any()
    # What is known within a metre of the chair's front hides it.
    chair = shapely.LineString([at[:2], CHAIR.centroid.coords[0]])
    if not has_chair or PILLAR.distance(chair) < 1.0:
        return
    assert found[is_chair & (seen < fan.range_m)].all()


def test_scans_say_what_is_nearest_from_the_rim_of_the_robots_of_a_floor() -> None:
    laser = scan("A", distances=np.array([8.0, 8.0, 1.0, 8.0, 8.0]))
    assert nearest([laser], 0.4) == (pytest.approx(0.6), "virtual")
    assert nearest([laser._replace(mount=(0.2, 0.0, 0.0))], 0.4) == (pytest.approx(0.8), "virtual")
    ring = scan("A", rim_m=0.4, range_m=1.0, distances=np.full(5, 0.7), is_virtual=False)
    assert nearest([laser, ring], 0.4) == (pytest.approx(0.6), "virtual")
    assert nearest([laser, ring], 0.6) == (pytest.approx(0.4), "virtual")
    for strange, kind in ((2, "in no map"), (1, "actual")):
        own = laser._replace(is_virtual=False, unmapped=np.arange(5) == strange)
        assert nearest([own, ring], 0.4) == (pytest.approx(0.6), kind)
    assert nearest([laser._replace(distances=np.zeros(5))], 0.4) == (0.0, "virtual")
    assert nearest([], 0.4) is None
    view = FloorView("L1")
    bodies = [Body(1, BodyKind.OBJECT, "desk", 0.0, ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), 127.0)]
    bodies.append(Body(2, BodyKind.ROBOT, "A", 0.4, (), 127.0))
    rows = np.array([(1, *[0.0] * 6), (2, 0.0, 0.0, 0.0, 1.0, 2.0, 0.5)], MOTION)
    view.apply(FloorUpdate("L1", WHOLE, 1, 9.5, 1, bodies, [], rows, {}))
    assert robots_on(view) == [SensedRobot("A", Pose("L1", 1.0, 2.0, 0.5), 0.4, 9.5)]
