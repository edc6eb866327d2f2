"""The protective field, in a closed loop with a base that follows late, in worlds of which only the scans know.

Rays, the base and distances are a model of its own, in simulated time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import box
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import AdaptorFailed, Blind, Bumped
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot import high_controller
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.high_controller import HighController
from robocorba.robot.motion.driving import Drive, DriveAt
from robocorba.robot.motion.motion import Motion
from robocorba.robot.motion.robot_state import ActorCommand, RobotState, Velocity
from robocorba.robot.protective_field import Obstructed as Seen
from robocorba.robot.protective_field import ProtectiveField
from robocorba.robot.senses import Ranges, RangeSensor, Reading, Senses
from robocorba.simulation.registry import Limits
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import Mount, ScanSpec

TICK_S, RADIUS_M, MARGIN_M = 0.02, 0.40, 0.05
#: Between two rays a corner is nearer than both their ends, by at most half of what lies between these [m].
BETWEEN_RAYS_M = 0.006
#: Beside a robot that passes slowly.
SLOW_M_S, BESIDE_M = 0.15, 0.01
AROUND = RangeSensor("laser", Mount(0.1, 0.05, 0.3), ScanSpec(Fan(-math.pi, math.pi / 180, 360, 8.0)))
#: Ends of straight lines, (n, 2, 2) [m].
Lines = Floats


class Lateness(NamedTuple):
    """Of a scan when it arrives, and of the base after its command [s]. has_gaps: every third scan has no echo."""

    scan_s: float = 0.1
    base_s: float = 0.04
    has_gaps: bool = False


class World(RobotAdaptor, Senses):
    """Lines, and a base among them that starts at the origin. Both adaptor and senses, as of an actual robot."""

    def __init__(self, lines: Lines, late: Lateness = Lateness(), heading: float = 0.0) -> None:  # noqa: B008
        self.lines, self._late = lines, late
        self.senses: Senses = self
        self.time = 0.0
        self._pose, self._moving = (0.0, 0.0, heading), (0.0, 0.0, 0.0)
        self._commands: list[tuple[float, Velocity]] = []
        self._scans: list[Ranges] = []
        self.contacts, self.fails, self.polls = 0, False, 0
        #: Time, position, speed and distance from the lines in all steps.
        self.track: list[tuple[float, float, float, float, float]] = []

    # ---- the adaptor ----

    def start(self, argv: Sequence[str]) -> bool:
        return True

    def stop(self) -> bool:
        return True

    def read(self, state: RobotState) -> bool:
        state.time, (state.x, state.y, state.heading), state.velocity = self.time, self._pose, self._moving
        return True

    def write(self, command: ActorCommand) -> bool:
        self._commands.append((self.time, command.velocity))
        return True

    # ---- the senses ----

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return [AROUND]

    def ranges(self, name: str) -> Ranges:
        self.polls += 1
        arrived = [scan for scan in self._scans if scan.time <= self.time - self._late.scan_s]
        if self.fails or not arrived:
            raise AdaptorFailed("the laser is off")
        return arrived[-1]

    def readings(self) -> Sequence[Reading]:
        return [Reading("bumper", "contacts", self.time, float(self.contacts))]

    # ---- the world ----

    def advance(self) -> None:
        """By a tick: the base follows its command, and the laser turns ten times a second."""
        if round(self.time / TICK_S) % 5 == 0:
            is_gap = self._late.has_gaps and len(self._scans) % 3 == 2
            self._scans.append(Ranges(self.time, np.full(AROUND.spec.fan.count, 8.0) if is_gap else self._cast()))
        wanted = next((each for when, each in reversed(self._commands) if when <= self.time - self._late.base_s), None)
        ahead, left, turn = wanted or (0.0, 0.0, 0.0)
        x, y, heading = self._pose
        c, s = math.cos(heading), math.sin(heading)
        self._moving = ahead, left, turn
        x, y = x + (c * ahead - s * left) * TICK_S, y + (s * ahead + c * left) * TICK_S
        self._pose = x, y, heading + turn * TICK_S
        self.time += TICK_S
        self.track.append((self.time, x, y, math.hypot(ahead, left), gap_m(self.lines, (x, y))))

    def _cast(self) -> Floats:
        x, y, heading = self._pose
        c, s = math.cos(heading), math.sin(heading)
        mount = AROUND.mount
        at = np.array((x + c * mount.ahead_m - s * mount.left_m, y + s * mount.ahead_m + c * mount.left_m))
        angles = -math.pi + np.arange(360) * math.pi / 180 + mount.heading + heading
        rays = np.column_stack((np.cos(angles), np.sin(angles)))[:, None, :]
        begin, along = self.lines[None, :, 0] - at, self.lines[None, :, 1] - self.lines[None, :, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = rays[..., 0] * along[..., 1] - rays[..., 1] * along[..., 0]
            distance = (begin[..., 0] * along[..., 1] - begin[..., 1] * along[..., 0]) / cross
            share = (begin[..., 0] * rays[..., 1] - begin[..., 1] * rays[..., 0]) / cross
        is_hit = (distance > 0.0) & (share >= 0.0) & (share <= 1.0)
        found: Floats = np.where(is_hit, distance, 8.0).min(axis=1, initial=8.0)
        return found


@pytest.fixture(autouse=True, scope="module")
def within_a_tick_no_time_passes() -> Iterator[None]:
    """Delays are those of a world: a busy machine adds none."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(high_controller, "time", SimpleNamespace(monotonic=lambda: 0.0))
        yield


class Stepped(HighController):
    """Its ticks are the test's."""

    def start(self, argv: Sequence[str]) -> None:
        self._begin()

    def drive(self, world: World, motion: Motion, limit_s: float = 60.0) -> None:
        """Raises the motion's error."""
        running = self._motion = high_controller._RunningMotion(motion)
        until = world.time + limit_s
        while not running.ended.is_set():
            assert world.time < until, "the motion does not end"
            self.tick(world)
        for _ in range(70):
            self.tick(world)
        if running.error:
            raise running.error

    def tick(self, world: World) -> None:
        assert self._field
        self._field.read()
        self._tick()
        world.advance()


def controller(world: World, carried: BaseGeometry | None = None, cap: float = 1.0) -> Stepped:
    field = ProtectiveField(lambda: world.senses, lambda: carried)
    high = Stepped(world, field=field)
    high.speed_cap = cap
    high.start(())
    return high


def square(x: float, y: float, side: float, angle: float) -> Lines:
    corners = [
        (x + side * 0.707 * math.cos(angle + k * math.pi / 2), y + side * 0.707 * math.sin(angle + k * math.pi / 2))
        for k in range(4)
    ]
    return np.array([(corners[k], corners[(k + 1) % 4]) for k in range(4)])


def gap_m(lines: Lines, at: tuple[float, float]) -> float:
    """Distance of a robot's rim from the nearest line."""
    if not len(lines):
        return math.inf
    begin, along = lines[:, 0] - at, lines[:, 1] - lines[:, 0]
    share = np.clip(-(begin * along).sum(1) / (along**2).sum(1), 0.0, 1.0)
    return float(np.hypot(*(begin + share[:, None] * along).T).min()) - RADIUS_M


SQUARES = st.builds(square, st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(0.1, 1.5), st.floats(0, 1.57))
WALLS = st.builds(
    lambda x, y, angle: np.array([[(x - 9 * math.cos(angle), y - 9 * math.sin(angle)), (x, y)]]),
    *(st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(0, 6.28)),
)
WORLDS = st.lists(SQUARES | WALLS, min_size=1, max_size=6).map(np.concatenate)
LATE = st.builds(Lateness, st.floats(0.0, 0.3), st.floats(0.0, 0.1), st.booleans())


@settings(deadline=None, max_examples=8)
@given(WORLDS, LATE, st.floats(0.05, 1.0), st.floats(-3.14, 3.14), st.floats(-1.0, 1.0), st.floats(0.0, 6.28))
def test_a_base_stands_before_what_is_in_its_way(
    lines: Lines, late: Lateness, speed: float, bearing: float, turn: float, heading: float
) -> None:
    assume(gap_m(lines, (0.0, 0.0)) > MARGIN_M + 0.02)
    world = World(lines, late, heading)
    motion = DriveAt((speed * math.cos(bearing), speed * math.sin(bearing), turn), 5.0)
    try:
        controller(world).drive(world, motion)
    except Seen as error:
        assert error.sensor == "laser"
        assert error.distance_m < MARGIN_M + 0.3
    for _, _, _, speed_m_s, distance_m in world.track:
        assert distance_m >= MARGIN_M or speed_m_s <= SLOW_M_S + 0.02
        assert distance_m > BESIDE_M - BETWEEN_RAYS_M


@settings(deadline=None, max_examples=6)
@given(SQUARES, LATE, st.floats(0.2, 1.0), st.floats(-0.35, 0.35))
def test_it_stands_at_least_five_centimetres_before_a_thing_ahead(
    thing: Lines, late: Lateness, speed: float, share: float
) -> None:
    middle = thing[:, 0].mean(axis=0)
    side_m = math.dist(*thing[0])
    bearing = math.atan2(middle[1], middle[0])
    off = share * side_m
    thing = thing + np.array((-off * math.sin(bearing), off * math.cos(bearing)))
    assume(gap_m(thing, (0.0, 0.0)) > MARGIN_M + 0.02)
    world = World(thing, late)
    with pytest.raises(Seen):
        controller(world).drive(world, DriveAt((speed * math.cos(bearing), speed * math.sin(bearing), 0.0), 90.0))
    _, _, _, at_end_m_s, distance_m = world.track[-1]
    assert at_end_m_s == 0.0
    assert min(row[4] for row in world.track) >= MARGIN_M
    assert distance_m < MARGIN_M + 0.04


@settings(deadline=None, max_examples=5)
@given(WORLDS, LATE, st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(0.2, 1.0))
def test_it_reaches_what_is_free(lines: Lines, late: Lateness, x: float, y: float, speed: float) -> None:
    steps = np.linspace((0.0, 0.0), (x, y), 100)
    assume(min(gap_m(lines, (a, b)) for a, b in steps.tolist()) > MARGIN_M + 0.03)
    world = World(lines, late)
    controller(world).drive(world, Drive([(x, y)], None, speed, Limits()))
    assert math.dist(world.track[-1][1:3], (x, y)) < 0.01


def test_it_goes_along_a_wall_and_away_from_one_but_not_into_it() -> None:
    wall = np.array([[(-9.0, 0.43), (9.0, 0.43)]])
    world = World(wall)
    high = controller(world)
    high.drive(world, DriveAt((0.3, 0.0, 0.0), 4.0))
    assert world.track[-1][1] > 0.4
    assert max(row[3] for row in world.track) <= SLOW_M_S + 1e-9
    with pytest.raises(Seen):
        high.drive(world, DriveAt((0.0, 0.3, 0.0), 30.0))
    assert world.track[-1][4] == pytest.approx(0.03, abs=1e-3)
    high.drive(world, DriveAt((0.1, -0.3, 0.0), 3.0))
    assert world.track[-1][4] > 0.6


def test_a_goal_at_the_margin_before_a_wall_is_reached_and_it_turns_beside_anything() -> None:
    world = World(np.array([[(2.0, -3.0), (2.0, 3.0)]]))
    controller(world).drive(world, Drive([(2.0 - RADIUS_M - MARGIN_M - 0.012, 0.0)], None, 1.0, Limits()))
    assert world.track[-1][4] == pytest.approx(MARGIN_M + 0.01, abs=0.005)
    world = World(square(0.71, 0.0, 0.6, math.pi / 4))
    assert gap_m(world.lines, (0.0, 0.0)) < 0.02
    controller(world).drive(world, DriveAt((0.0, 0.0, 1.0), 2.0))
    assert world._pose[2] > 1.5


def test_what_it_carries_does_not_stop_it() -> None:
    table = square(0.9, 0.0, 0.5, math.pi / 4)
    world = World(np.concatenate((table, table + np.array((0.0, 3.0)))))
    controller(world, box(0.55, -0.35, 1.25, 0.35)).drive(world, DriveAt((0.3, 0.0, 0.0), 1.0))
    world = World(table)
    with pytest.raises(Seen):
        controller(world).drive(world, DriveAt((0.3, 0.0, 0.0), 30.0))


def test_a_robot_whose_sensor_is_silent_stands_and_says_why() -> None:
    world = World(np.zeros((0, 2, 2)))
    high = controller(world)
    world.fails = True
    with pytest.raises(Blind, match="laser: the laser is off"):
        high.drive(world, DriveAt((0.3, 0.0, 0.0), 30.0))
    assert world.track[-1][1] == 0.0
    world.fails = False
    high.drive(world, DriveAt((0.3, 0.0, 0.0), 1.0))
    was_at, before_s = world.track[-1][1], world.time
    assert was_at > 0.2
    world._scans.clear()
    world.fails = True
    with pytest.raises(Blind):
        high.drive(world, DriveAt((0.8, 0.0, 0.0), 30.0))
    moved_s = [row[0] - before_s for row in world.track if row[0] > before_s and row[3] > 0.0]
    assert max(moved_s, default=0.0) < 0.625 + 0.8 + 0.2


def test_a_contact_ends_the_motion_and_the_next_one_may_leave() -> None:
    world = World(np.zeros((0, 2, 2)))
    high = controller(world)
    world.contacts = 3  # before: of no concern
    high._field._on_contact = high.cancel  # type: ignore[union-attr]
    running = high._motion = high_controller._RunningMotion(DriveAt((0.3, 0.0, 0.0), 30.0))
    for _ in range(50):
        high.tick(world)
    assert not running.ended.is_set()
    world.contacts = 4
    for _ in range(60):
        high.tick(world)
    assert isinstance(running.error, Bumped)
    assert world.track[-1][3] == 0.0
    high.drive(world, DriveAt((-0.3, 0.0, 0.0), 1.0))


def test_the_display_waits_for_a_free_way_only_while_the_field_holds_the_base() -> None:
    """Until what is in the way goes; and no longer than the drive that fails."""
    thing = square(1.2, 0.0, 0.5, 0.0)
    world = World(thing)
    high = controller(world)
    shown: list[str] = []

    class Watched(DriveAt):
        def command(self, state: RobotState, elapsed_s: float) -> Any:
            shown.append(high._awaited)  # `awaited` also says whether this test gets its processor time
            if shown[-50:] == [shown[-1]] * 50 and shown[-1]:  # for a second
                world.lines = np.zeros((0, 2, 2))
            return super().command(state, elapsed_s)

    high.drive(world, Watched((0.3, 0.0, 0.0), 12.0))
    spells = ((text, len(list(ticks))) for text, ticks in itertools.groupby(text.partition(":")[0] for text in shown))
    texts = [text for text, _ in itertools.groupby(text for text, count in spells if count > 4)]
    assert texts[-3:] == ["", "a free way", ""]  # without moments; a first scan may be late on a busy machine
    world.lines = square(world.track[-1][1] + 1.2, 0.0, 0.5, 0.0)
    with pytest.raises(Seen):
        high.drive(world, DriveAt((0.3, 0.0, 0.0), 30.0))
    assert high._awaited == ""
