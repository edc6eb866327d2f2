"""The protective field: a base slows down and stops before what its own range sensors see, whatever the map says.

A scan is placed on the floor by the robot's pose at its time. What lies where the robot's disc would drive leaves a
free distance, and the speed is limited to the one from which latency and braking end within it. Only what lies ahead
counts: a robot may drive away from anything, along a wall, and turn on the spot."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import Blind, Bumped, MotionFailed
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.collision_avoidance.giving_way import Blocked
from robocorba.robot.collision_avoidance.neighbours import OtherRobot
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.senses import RangeSensor, Senses
from robocorba.simulation.sensing.scan import PROXIMITY
from robocorba.system.repeating import Repeating

#: Distance before which the base stands [m]: 5 cm, and 1 cm for corners between two rays and for noise.
MARGIN_M = 0.06
#: What is at least this far beside the driving robot does not stop it [m]; within MARGIN_M it passes at CRAWL_M_S.
SIDE_M, CRAWL_M_S = 0.01, 0.15
#: Braking that the field counts on [m/s^2]; the rest of the limit compensates for a base that follows late.
BRAKING_M_S2 = 0.8 * BASE_LIMITS.acceleration
#: Time for which a base may drive on [s], beside the age of the scan and delays of this process: a control cycle, and
#: the validity of a command.
REACTION_S = 0.12
#: Age from which a scan protects nobody [s]: who walks (1.6 m/s, ISO 13855) crosses the proximity sensors' range in it.
MAX_AGE_S = PROXIMITY.range_m / 1.6
#: Interval between readings while the base is to move, and for a second after; and between looks whether it is [s].
READ_S, _IDLE_S = 0.05, 1.0
#: Time for which at most this speed [m/s] is allowed, after which the motion fails [s].
HELD_S, HELD_M_S = 3.0, 0.01

_log = logging.getLogger(__name__)


class Obstructed(Blocked):
    """`sensor` sees something in the robot's way, `distance_m` from its rim [m], at a point of the floor `at` [m]."""

    def __init__(self, state: RobotState, sensor: str, distance_m: float, at: XY) -> None:
        self.sensor, self.distance_m, self.at = sensor, distance_m, at
        super().__init__(state, None, f"{sensor} sees something {distance_m:.2f} m from its rim")


class _Scan(NamedTuple):
    """Ends of the rays that had an echo (n, 2) [m], in the robot's frame or placed on the floor; time: [s]."""

    time: float
    ends: Floats


class ProtectiveField:
    """One thread observes and asks, another one reads. senses: of the robot, None without any; then it allows all.
    carried: what moves with the robot, in its frame [m]. robot_at: the robot at a point of the floor [m]: who meets
    another one gives way to it, as without the field."""

    def __init__(
        self,
        senses: Callable[[], Senses | None],
        carried: Callable[[], BaseGeometry | None] = lambda: None,
        robot_at: Callable[[float, float], OtherRobot | None] = lambda x, y: None,
    ) -> None:
        self._senses, self._carried, self._robot_at = senses, carried, robot_at
        self._reader = Repeating(
            "protective field", self._read_while_needed, lambda: READ_S if self._is_needed else _IDLE_S
        )
        self._on_contact: Callable[[MotionFailed], None] = lambda error: None
        #: Until when the sensors are read, by the clock [s].
        self._needed_until = 0.0
        #: By sensor: its latest scan, and why it could not be read last.
        self._scans: dict[str, _Scan] = {}
        self._problems: dict[str, str] = {}
        #: The last scan of each sensor that was placed, and the same on the floor.
        self._placed: dict[str, tuple[_Scan, _Scan]] = {}
        #: Contacts that the bumper has counted; None while nobody reads it.
        self._contacts: float | None = None
        self._state, self._late_s = RobotState(), 0.0
        #: Time and pose of the last control cycles.
        self._poses: deque[tuple[float, Frame]] = deque(maxlen=100)
        self._held_since: float | None = None
        #: What holds the base, for display; empty if nothing does.
        self.awaited = ""

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        """What it looks with; known once the adaptor has started."""
        senses = self._senses()
        return senses.sensors if senses else ()

    def start(self, on_contact: Callable[[MotionFailed], None]) -> None:
        """on_contact: called after each contact that the bumper counts while the robot is to move."""
        self._on_contact = on_contact
        self._reader.start()

    def close(self) -> None:
        self._reader.close()

    # ---- in the control loop ----

    def observe(self, state: RobotState, late_s: float = 0.0) -> None:
        """To be called in each control cycle. late_s: from a reading of the state until its command arrives."""
        here = state.x, state.y, state.heading
        if self._poses and (state.time < self._poses[-1][0] or math.dist(here[:2], self._poses[-1][1][:2]) > 0.5):
            self._poses.clear()  # another clock, or another place
            self._placed, self._scans = {}, {}
        if not self._poses or state.time > self._poses[-1][0]:
            self._poses.append((state.time, here))
        self._state, self._late_s = state, late_s

    def attend(self) -> None:
        """Have the sensors read from now on, as the base is to move."""
        now = time.monotonic()
        if now > self._needed_until:
            self._needed_until = now + 1.0
            self._reader.wake()
        self._needed_until = now + 1.0

    def allowed_m_s(self, vx: float, vy: float) -> float:
        """The speed that is allowed in the direction of a velocity, along the floor's axes."""
        return self._limit(vx, vy)[0]

    def hold(self, vx: float, vy: float) -> float:
        """The same for the velocity that a motion wants. Raises Obstructed, Blind once it has been held for HELD_S."""
        allowed_m_s, error = self._limit(vx, vy)
        self.awaited = f"a free way: {error}" if error else ""
        if error is None:
            self._held_since = None
        elif self._held_since is None:
            self._held_since = self._state.time
        elif self._state.time - self._held_since >= HELD_S:
            self._held_since = None
            if isinstance(error, Obstructed):
                error.other = self._robot_at(*error.at)
            raise error
        return allowed_m_s

    def _limit(self, vx: float, vy: float) -> tuple[float, MotionFailed | None]:
        """The allowed speed, and the error if the robot has to stand."""
        state, speed = self._state, math.hypot(vx, vy)
        least, seen = math.inf, ("", math.inf, (math.inf, math.inf))
        if speed == 0.0:
            return least, None
        for sensor in self.sensors:
            scan, age_s = self._scan(sensor.name)
            if scan is None or age_s > MAX_AGE_S:
                why = self._problems.get(sensor.name) or (f"its scan is {age_s:.2f} s old" if scan else "no scan yet")
                return 0.0, Blind(sensor.name, why)
            found, distance_m, what = allowed_speed(
                scan.ends - (state.x, state.y), (vx / speed, vy / speed), age_s + self._late_s + REACTION_S
            )
            if found < least:
                least, seen = found, (sensor.name, distance_m, (state.x + what[0], state.y + what[1]))
        return least, Obstructed(state, *seen) if least <= HELD_M_S else None

    def _scan(self, name: str) -> tuple[_Scan | None, float]:
        """The latest scan of a sensor on the floor, and its age [s]."""
        scan = self._scans.get(name)
        if scan is None or not self._poses:
            return None, math.inf
        placed = self._placed.get(name)
        if placed is None or placed[0] is not scan:
            x, y, heading = self._pose_at(scan.time)
            c, s = math.cos(heading), math.sin(heading)
            on_floor = scan._replace(ends=scan.ends @ np.array([[c, s], [-s, c]]) + (x, y))
            placed = self._placed[name] = scan, on_floor
        return placed[1], max(0.0, self._state.time - scan.time)

    def _pose_at(self, when: float) -> Frame:
        """The pose at a time, between those of control cycles."""
        later = self._poses[-1]
        for earlier in reversed(self._poses):
            if earlier[0] <= when:
                break
            later = earlier
        else:
            return later[1]
        (before_s, (x, y, heading)), (after_s, (to_x, to_y, to_heading)) = earlier, later
        share = min(1.0, (when - before_s) / (after_s - before_s)) if after_s > before_s else 0.0
        turned_rad = math.remainder(to_heading - heading, math.tau)
        return x + share * (to_x - x), y + share * (to_y - y), heading + share * turned_rad

    # ---- in the thread that reads ----

    def _read_while_needed(self) -> None:
        if self._is_needed:
            self.read()
        else:
            self._contacts = None

    @property
    def _is_needed(self) -> bool:
        return time.monotonic() < self._needed_until

    def read(self) -> None:
        """Read all sensors once."""
        senses = self._senses()
        if senses is None:
            return
        try:
            self._count_contacts(senses)
        except RoboCorbaError as error:
            _log.debug("bumper: %s", error)
        for sensor in senses.sensors:
            try:
                self._read_ranges(senses, sensor)
            except RoboCorbaError as error:
                self._problems[sensor.name] = str(error)

    def _count_contacts(self, senses: Senses) -> None:
        contacts = sum(reading.value for reading in senses.readings() if reading.name == "bumper")
        before, self._contacts = self._contacts, contacts
        if before is not None and contacts > before:
            self._on_contact(Bumped(int(contacts - before)))

    def _read_ranges(self, senses: Senses, sensor: RangeSensor) -> None:
        asked_at = time.monotonic()
        found = senses.ranges(sensor.name)
        took_s = time.monotonic() - asked_at  # some robots' clock is that of arrival here
        mount, spec = sensor.mount, sensor.spec
        hits = found.distances < spec.fan.range_m
        lengths = found.distances[hits] + spec.rim_m
        angles = spec.fan.angles[hits] + mount.heading
        ahead, left = mount.ahead_m + lengths * np.cos(angles), mount.left_m + lengths * np.sin(angles)
        ends = np.column_stack((ahead, left))
        if (carried := self._carried()) is not None:
            ends = ends[~shapely.contains_xy(carried, ahead, left)]
        self._problems.pop(sensor.name, None)
        self._scans[sensor.name] = _Scan(found.time - took_s, ends)


def allowed_speed(obstacles: Floats, direction: XY, latency_s: float) -> tuple[float, float, XY]:
    """The speed [m/s] at which a robot may drive in a direction (a unit vector), and of what limits it the distance
    from the robot's rim and the place [m]; infinite where nothing does. obstacles: (n, 2) from the robot's centre
    [m]."""
    along = obstacles @ direction
    is_ahead = along > 0.0
    if not is_ahead.any():
        return math.inf, math.inf, (math.inf, math.inf)
    distances = np.hypot(*obstacles.T)
    # Beside a wall that is nearer, the robot may still drive along it.
    side_m = min(max(float(distances.min()) - RADIUS_M - 0.002, 0.0), SIDE_M)
    ahead, distances = along[is_ahead], distances[is_ahead]
    across = np.sqrt(np.maximum(distances**2 - ahead**2, 0.0))
    wide_m = RADIUS_M + MARGIN_M
    free = np.maximum(ahead - np.sqrt(np.maximum(wide_m**2 - across**2, 0.0)), 0.0)
    final = np.where(across < RADIUS_M + side_m, 0.0, CRAWL_M_S)
    speeds = np.maximum(speed_within(free, latency_s, final), final)
    speeds[across >= wide_m] = math.inf
    least = int(speeds.argmin())
    x, y = obstacles[is_ahead][least]
    return float(speeds[least]), float(distances[least]) - RADIUS_M, (float(x), float(y))


def speed_within(free_m: Floats, latency_s: float, final_m_s: Floats) -> Floats:
    """The speed from which, after the latency, the base brakes to its final speed within a distance: the solution of
    v latency + (v^2 - final^2) / (2 braking) = free."""
    late = BRAKING_M_S2 * latency_s
    found: Floats = np.sqrt(late * late + 2.0 * BRAKING_M_S2 * free_m + final_m_s**2) - late
    return found
