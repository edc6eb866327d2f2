"""The protective field: a base slows down and stops before what its own range sensors see, whatever the map says.

Scans are placed on the floor by the robot's pose at their time, and count until they are too old: a ray without an echo
does not show that what it met before has gone. What lies where the robot's disc would drive leaves a
free distance, and the speed is limited to the one from which latency and braking end within it. Only what lies ahead
counts: a robot may drive away from anything, along a wall, and turn on the spot."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from shapely.geometry.base import BaseGeometry

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import Blind, Bumped, MotionFailed
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.collision_avoidance.braking import REACTION_S, allowed_speed
from robocorba.robot.collision_avoidance.giving_way import Blocked
from robocorba.robot.collision_avoidance.neighbours import OtherRobot
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.scans import PoseTrack, Scan, read_scan
from robocorba.robot.senses import RangeSensor, Senses
from robocorba.simulation.sensing.scan import PROXIMITY
from robocorba.system.repeating import Repeating

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
        #: By sensor: its new scans, and why it could not be read last.
        self._arrived: dict[str, deque[Scan]] = {}
        self._problems: dict[str, str] = {}
        #: By sensor: its last scans on the floor. Where one ray has no echo, an earlier one had.
        self._placed: dict[str, deque[Scan]] = {}
        #: Contacts that the bumper has counted; None while nobody reads it.
        self._contacts: float | None = None
        self._state, self._late_s = RobotState(), 0.0
        self._track = PoseTrack()
        self._held_since: float | None = None
        #: What holds the base, for display; empty if nothing does.
        self.awaited = ""

    def start(self, on_contact: Callable[[MotionFailed], None]) -> None:
        """on_contact: called after each contact that the bumper counts while the robot is to move."""
        self._on_contact = on_contact
        self._reader.start()

    def close(self) -> None:
        self._reader.close()

    # ---- in the control loop ----

    def observe(self, state: RobotState, late_s: float = 0.0) -> None:
        """To be called in each control cycle. late_s: from a reading of the state until its command arrives."""
        if self._track.observe(state):
            self._placed, self._arrived = {}, {}
        self._state, self._late_s = state, late_s

    def attend(self) -> None:
        """Have the sensors read from now on, as the base is to move."""
        was_needed, self._needed_until = self._is_needed, time.monotonic() + 1.0
        if not was_needed:
            self._reader.wake()

    def hold(self, vx: float, vy: float) -> float:
        """The speed that is allowed in the direction of the velocity that a motion wants. Raises Obstructed, Blind once
        it has been held for HELD_S."""
        allowed_m_s, error = self.limit(vx, vy)
        # The first scan of a drive takes a moment, which is not shown.
        is_shown = self._held_since is not None and self._state.time - self._held_since >= 5 * READ_S
        self.awaited = f"a free way: {error}" if error and is_shown else ""
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

    def limit(self, vx: float, vy: float) -> tuple[float, MotionFailed | None]:
        """The speed that is allowed in the direction of a velocity, along the floor's axes, and the error if the robot
        has to stand."""
        state, speed, senses = self._state, math.hypot(vx, vy), self._senses()
        least, seen = math.inf, ("", math.inf, (math.inf, math.inf))
        if speed == 0.0:
            return least, None
        for sensor in senses.sensors if senses else ():
            scans = self._scans(sensor.name)
            age_s = max(0.0, state.time - scans[-1].time) if scans else math.inf
            if age_s > MAX_AGE_S:
                why = self._problems.get(sensor.name) or (f"its scan is {age_s:.2f} s old" if scans else "no scan yet")
                return 0.0, Blind(sensor.name, why)
            ends = np.concatenate([scan.ends[scan.is_hit] for scan in scans]) - (state.x, state.y)
            found, distance_m, what = allowed_speed(ends, (vx / speed, vy / speed), age_s + self._late_s + REACTION_S)
            if found < least:
                least, seen = found, (sensor.name, distance_m, (state.x + what[0], state.y + what[1]))
        return least, Obstructed(state, *seen) if least <= HELD_M_S else None

    def _scans(self, name: str) -> Sequence[Scan]:
        """The scans of a sensor on the floor that are not too old, or the latest one."""
        placed, arrived = self._placed.setdefault(name, deque()), self._arrived.get(name)
        while arrived:
            scan = arrived.popleft()
            if pose := self._track.at(scan.time):
                placed.append(scan.placed(pose))
        while len(placed) > 1 and self._state.time - placed[0].time > MAX_AGE_S:
            placed.popleft()
        return placed

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
        scan = read_scan(senses, sensor, self._carried())
        self._arrived.setdefault(sensor.name, deque(maxlen=20)).append(scan)  # control cycles may be late
        self._problems.pop(sensor.name, None)
