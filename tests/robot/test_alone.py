"""What a robot without servers has instead: a session, a map, a floor; and its body while there is a server."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from robocorba.errors.paths import NoPath, UnknownFloor
from robocorba.errors.robots import RobotLost, ServerAway
from robocorba.map_editor import native
from robocorba.planning.request import PathRequest, Place
from robocorba.robot.body_in_building import FOLLOW_S, RETRY_S, BodyInBuilding
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.local_map import LocalFloor, LocalMap, kept_map
from robocorba.robot.local_session import LocalSession, kept_pose
from robocorba.robot.motion.robot_state import RobotState
from robocorba.simulation.emergency_stops import NOT_HELD, StopHold
from robocorba.simulation.registry import Pose
from robocorba.simulation.sensing.scan import Mount, ray_sensor
from robocorba.system.record_file import RecordFile
from robocorba.system.stop_latch import StopLatch
from tests.simulation.places import tower

START = Pose("L1", 7.0, 2.0, 0.5)
#: What may happen between two calls of the server.
MEANWHILE = ("-", "-", "stop robot", "stop and call", "stop", "reset", "cut")
T = TypeVar("T")
AT_START = RobotState(x=7.0, y=2.0, heading=0.5)


def record_file(folder: Path) -> RecordFile:
    return RecordFile(folder / "agent.sqlite", 1, 1)


@pytest.fixture
def records(tmp_path: Path) -> Iterator[RecordFile]:
    with record_file(tmp_path) as found:
        yield found


def test_the_session_is_where_the_adaptor_says_and_remembers_it(records: RecordFile) -> None:
    reported = [AT_START]
    session = LocalSession(records, START, lambda: reported[-1])
    assert (session.state().at, kept_pose(records)) == (START, None)
    session.keep_pose()
    assert kept_pose(records) is None
    reported.append(RobotState(time=3.0, x=7.5, y=2.0, heading=0.5, velocity=(0.1, 0.0, 0.0)))
    session.keep_pose()
    assert kept_pose(records) == session.latest.at == Pose("L1", 7.5, 2.0, 0.5)
    assert (session.latest.time, session.latest.velocity) == (3.0, (0.1, 0.0, 0.0))
    reported.append(RobotState(x=7.505, y=2.0, heading=0.5))  # noise of the odometry is not written
    session.keep_pose()
    assert kept_pose(records) == Pose("L1", 7.5, 2.0, 0.5)
    reported.append(RobotState(x=7.5, y=2.0, heading=0.6))
    session.keep_pose()
    assert kept_pose(records) == Pose("L1", 7.5, 2.0, 0.6)


def test_what_only_the_simulation_server_has_is_refused(records: RecordFile) -> None:
    session = LocalSession(records, START, lambda: AT_START)
    for call in (
        lambda: session.announce_body(True),
        lambda: session.scan(START, Mount(0.0, 0.0, 0.0), ray_sensor("laser").spec(0.0)),
        lambda: session.grip("T1", 1.0, 1.0),
        lambda: session.call_elevator("E1", "L2"),
        session.longest_elevator_wait_s,
        lambda: session.reserve([], 1.0),
        lambda: session.reserve_one_of([], 1.0),
        lambda: session.exchange_areas([], 1.0),
        lambda: session.take_over_areas("B"),
        lambda: session.keep_areas([]),
    ):
        with pytest.raises(RobotLost, match="needs the simulation server"):
            call()
    session.announce_body(False)
    assert session.reservation() is None


def test_the_map_is_kept_and_paths_stay_on_its_floor(records: RecordFile) -> None:
    assert kept_map(records) is None
    place = LocalMap(records, tower(), 1, "L1")
    place.take(tower(), 2)
    kept = kept_map(records)
    assert kept and kept.version == 2 and native.loads(kept.text) == tower()
    (path,) = place.paths(PathRequest(Place("L1", 7.0, 2.0), Place("L1", 2.0, 8.0)))
    assert {point.floor for point in path.points} == {"L1"} and place.planner.version == 2
    with pytest.raises(NoPath, match="E1"):
        place.paths(PathRequest(Place("L1", 7.0, 2.0), Place("L2", 2.0, 8.0)))
    for floor in ("L3", ""):
        with pytest.raises(UnknownFloor):
            LocalMap(records, tower(), 1, floor)
    without = tower()
    del without.floors["L1"]
    without.elevators.clear()
    place.take(without, 3)
    with pytest.raises(UnknownFloor):
        place.of("L1")


def test_the_pool_holds_its_floor(records: RecordFile) -> None:
    robot = RobotState(x=7.0, y=2.0, velocity=(0.2, 0.0, 0.0))
    place = LocalMap(records, tower(), 1, "L1")
    floor = LocalFloor(place, "A", lambda: robot)
    pool = DataPool(floor.changes, place.of, "L1", "A")
    pool.follow()
    first = pool.current_snapshot()
    own, table = first.robot("A"), first.object("T1")
    assert own and table and (own.x, own.y, own.vx) == (7.0, 2.0, pytest.approx(0.2))
    assert (table.x, table.y, table.is_movable) == (2.0, 2.0, True)
    robot.x = 6.0
    pool.follow()
    later = pool.current_snapshot()
    moved = later.robot("A")
    assert moved and moved.x == 6.0 and later.version > first.version
    assert not later.changes(first.version).came  # only what has moved
    nearby = Nearby(pool, "A")
    assert nearby.others(6.0, 2.0) == []
    obstacles = nearby.movable_objects()
    assert (obstacles.names, obstacles.without_movables) == (("T1",), ("L1",))
    assert nearby.clearance_m(3.5, 1.0) == pytest.approx(0.5, abs=0.06)  # from the wall
    without = tower()
    del without.floors["L1"].geometrical.objects["T1"]
    place.take(without, 2)
    pool.follow()
    assert pool.current_snapshot().object("T1") is None
    with pytest.raises(UnknownFloor):
        floor.changes("L3", 0)


class Server(LocalSession):
    """A session at a simulation server. is_away: it does not answer. script: what happens before and after its calls,
    as if another thread had been quicker."""

    is_away = False
    script: Sequence[Callable[[], None]] = ()

    def hold(self) -> StopHold:
        return self._answer(super().hold)

    def report_stop(self, reason: str) -> tuple[bool, StopHold]:
        return self._answer(lambda: super(Server, self).report_stop(reason))

    def end_stops(self, number: int) -> StopHold:
        return self._answer(lambda: super(Server, self).end_stops(number))

    def _answer(self, call: Callable[[], T]) -> T:
        self._happen()
        found = call()
        self._happen()
        return found

    def _happen(self) -> None:
        if self.script:
            what, *self.script = self.script
            what()
        if self.is_away:
            raise ServerAway("no answer")


class Robot:
    """A robot with its latch of stops."""

    actor: RobotState | None = RobotState(x=7.0, y=2.0)

    def __init__(self, session: LocalSession, latch: StopLatch | None = None) -> None:
        self.session, self.latch = session, latch or StopLatch()

    def stop(self, reason: str) -> None:
        self.latch.stop(reason)

    @property
    def held(self) -> str:
        return self.latch.reason


class Body(BodyInBuilding):
    """received: number of the last stop of the server that the robot has."""

    received = 0

    def stop(self, reason: str, number: int = 0) -> None:
        self.received = max(self.received, number)
        super().stop(reason, number)


class SharedStops(RuleBasedStateMachine):
    """Stops at either side, resets at the robot, and a link that is cut. No stop ends but by a later reset."""

    @initialize()
    def begin(self) -> None:
        self.closing = contextlib.ExitStack()
        folder = Path(self.closing.enter_context(tempfile.TemporaryDirectory()))
        self.server = Server(self.closing.enter_context(record_file(folder)), START, lambda: AT_START)
        self.start_robot(StopLatch())
        #: Whether there is a stop after the last reset, and whether one came from the server.
        self.is_held = self.is_from_server = False

    def start_robot(self, latch: StopLatch) -> None:
        self.robot: Any = Robot(self.server, latch)
        self.body = Body(self.server, self.robot)
        #: Number of the server's last stop.
        self.last = self.server._hold.number if self.server._hold.is_held else 0

    def teardown(self) -> None:
        if hasattr(self, "closing"):
            self.closing.close()

    @rule(is_cut=st.booleans())
    def link(self, is_cut: bool) -> None:
        self.server.is_away = is_cut

    @rule()
    def stop_robot(self) -> None:
        self.robot.stop("button")
        self.is_held = True

    @rule(is_called=st.booleans())
    def stop_at_server(self, is_called: bool) -> None:
        """is_called: the robot gets the last stop, which stands for all before it, before the body follows."""
        hold = StopHold(True, self.server._hold.number + 1, "fire")
        self.server._change(hold)
        self.is_held, self.last, self.is_from_server = True, hold.number, True
        if is_called and not self.server.is_away:
            self.body.stop("fire", hold.number)

    @rule()
    def forget_stops(self) -> None:
        """Another server, which has other numbers."""
        self.server._change(NOT_HELD._replace(number=self.server._hold.number + 3))
        self.is_held, self.last, self.is_from_server = bool(self.robot.held), 0, False

    @rule()
    def reset(self) -> None:
        self.robot.latch.end(self.robot.latch.number)
        self.is_held = self.body.received < self.last
        self.is_from_server &= self.is_held

    @rule()
    def kill_robot(self) -> None:
        """What holds it is in its own file; what it knew of the server's stops is not."""
        latch = self.robot.latch
        self.start_robot(StopLatch(latch.number, latch.reasons))
        self.is_held |= self.server._hold.is_held

    @rule(script=st.lists(st.sampled_from(MEANWHILE), max_size=3))
    def follow_meanwhile(self, script: list[str]) -> None:
        """Stops and resets between the calls of the server."""
        calls = {
            "-": lambda: None,
            "stop robot": self.stop_robot,
            "stop and call": lambda: self.stop_at_server(True),
            "stop": lambda: self.stop_at_server(False),
            "reset": self.reset,
            "cut": lambda: self.link(True),
        }
        self.server.script = [calls[what] for what in script]
        self.body.follow()
        self.server.script = ()
        assert self.server._hold.is_held or not self.is_from_server, "a stop of the server has ended"

    @rule()
    def follow(self) -> None:
        self.body.follow()
        if self.server.is_away:
            assert self.body.pause_s == RETRY_S
            return
        self.body.follow()  # a first one may have logged on
        assert self.body.pause_s == FOLLOW_S
        assert bool(self.robot.held) == self.server.hold().is_held == self.is_held


def test_a_reset_ends_no_stop_of_the_server_that_came_while_the_robot_reported_its_own() -> None:
    shared: Any = SharedStops()  # type: ignore[no-untyped-call]
    shared.begin()
    with shared.closing:
        shared.follow_meanwhile(["stop robot", "stop"])
        shared.follow_meanwhile(["reset"])
        shared.follow()


TestSharedStops = SharedStops.TestCase
TestSharedStops.settings = settings(max_examples=20, stateful_step_count=25, deadline=None)


def test_a_body_that_is_left_behind_logs_on_where_the_robot_is(records: RecordFile) -> None:
    ons: list[Pose | None] = []
    commands: list[Any] = []

    class Building(LocalSession):
        def log_on(self, at: Pose | None = None) -> None:
            ons.append(at)

        def command(self, velocity: Any, valid_s: float) -> None:
            commands.append(velocity)

    session = Building(records, START, lambda: AT_START)  # it stays at the start
    robot: Any = Robot(LocalSession(records, START, lambda: RobotState(x=7.3, y=2.0)))
    robot.actor = RobotState(x=7.3, y=2.0, heading=0.5)
    body = BodyInBuilding(session, robot)
    body.follow()
    assert len(commands) == 1 and commands[0][0] > 0.5
    robot.actor = RobotState(x=8.5, y=2.0, heading=0.5)
    body.follow()
    assert len(commands) == 1 and body.pause_s == RETRY_S
    body.follow()
    assert ons == [Pose("L1", 7.3, 2.0, 0.5), Pose("L1", 8.5, 2.0, 0.5)]
    robot.actor = None
    body.follow()
    body.leave()
