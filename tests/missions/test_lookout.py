"""What comes into the way of a carried body, and how its pace follows."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point

from robocorba.errors.services import NotReachable
from robocorba.missions import lookout as module
from robocorba.missions.clearing import Requests
from robocorba.missions.leader_policy import DEFAULT_POLICY
from robocorba.missions.lookout import Lookout, Seen, WayAhead
from robocorba.missions.messages import WayMade
from robocorba.missions.obstacles import placed
from robocorba.missions.trajectory import Trajectory

PATH = Trajectory([(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)])
NUMBERED = (("table", 7), ("chair", 8))
BODY = shapely.box(-0.5, -0.4, 0.5, 0.4)
GAP_M, LOOK_S, STOP_S = DEFAULT_POLICY.way_gap_m, DEFAULT_POLICY.look_ahead_s, DEFAULT_POLICY.stop_ahead_s


def robot(x: float, y: float, vx: float = 0.0, vy: float = 0.0, name: str = "r") -> Seen:
    return Seen(name, True, Point(x, y).buffer(0.3), vx, vy)


def looking_at(*seen: Seen) -> Lookout:
    return Lookout(PATH, BODY, {"A", "table"}, lambda: seen, DEFAULT_POLICY)


def test_what_stands_ahead_is_seen_in_time() -> None:
    lookout = looking_at(robot(3.0, 0.0))
    assert lookout.ahead(0.0) is None
    reached_s = next(t / 100 for t in range(2000) if PATH.at(t / 100)[0][0] >= 3.0 - 0.3 - 0.5 - GAP_M)
    assert lookout.ahead(reached_s - 3.0) == (robot(3.0, 0.0), pytest.approx(3.0, abs=0.3))
    assert lookout.ahead(reached_s - LOOK_S - 0.5) is None
    assert lookout.ahead(reached_s + 0.1) == (robot(3.0, 0.0), 0.0)


def test_the_team_and_what_is_beside_are_not_in_the_way() -> None:
    assert looking_at(robot(1.0, 0.0, name="A"), robot(1.0, 0.0, name="table")).ahead(4.0) is None
    assert looking_at(robot(2.0, 0.4 + 0.3 + 2 * GAP_M)).ahead(7.0) is None
    assert looking_at(robot(2.0, 0.4 + 0.3 - 0.01)).ahead(7.0) is not None


def test_the_team_is_known_under_other_names() -> None:
    table, chair = (Seen(name, False, Point(1.0, 0.0).buffer(0.3), 0.0, 0.0, number) for name, number in NUMBERED)
    seen = [table]
    lookout = Lookout(PATH, BODY, {"A", "table"}, lambda: seen, DEFAULT_POLICY)
    assert lookout.ahead(4.0) is None
    seen[:] = [table._replace(name="L1/table")]
    assert lookout.ahead(4.0) is None
    seen[:] = [table._replace(name="L1/table"), chair]
    assert lookout.ahead(4.0) is not None
    seen[:] = [chair._replace(name="table"), table._replace(name="stranger")]  # after a restart of the simulation
    found = lookout.ahead(4.0)
    assert found is not None and found[0].name == "stranger"


def test_what_moves_is_seen_where_it_will_be() -> None:
    beside = 0.4 + 0.3 + 0.5
    assert looking_at(robot(1.5, beside)).ahead(4.0) is None
    assert looking_at(robot(1.5, beside, vy=-0.6)).ahead(4.0) is not None
    assert looking_at(robot(1.5, beside, vy=0.6)).ahead(4.0) is None


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


def test_the_pace_follows_what_is_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_the_body_stops_once_its_way_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(monkeypatch)
    assert scene.rate() == 1.0
    scene.seen = NotReachable("positions of other robots are unknown")
    assert scene.rate() == 1.0
    assert scene.rate(1.5) == 0.0
    assert scene.way.reason == "what is in the way is unknown"
    scene.seen = None
    scene.rate()
    assert scene.rate(1.0) == 1.0
