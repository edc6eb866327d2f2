"""The mobility unit: a base that drives in any direction, by jogs or along ways, and says where it is."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from robocorba.kinematics.smartpal import BASE
from robocorba.smartpal.codes import Answer, AxesState, MobilityState
from robocorba.smartpal.dynamics import STEP_S, Dynamics
from robocorba.smartpal.glide import Glide
from robocorba.smartpal.unit import JOG_TIMEOUT_MS, LEAST_JOG_TIMEOUT_MS, MOST_JOG_TIMEOUT_MS, Unit
from robocorba.smartpal.way import Arc, Place, Straight, Way, placed, seen_from, turned

#: Of the base: mm/s and mm/s^2, degrees/s and degrees/s^2; and at power-up.
MOST_MM_S, MOST_DEG_S = 1000.0 * BASE.speed, math.degrees(BASE.turn)
FIRST_MM_S, FIRST_DEG_S = 100.0, 10.0
#: What the wheels hold when it brakes: half of gravity, on wheels about 0.25 m from the middle; ours.
BRAKE_M_S2, TURN_BRAKE_RAD_S2 = 4.9, 20.0
#: On a way it takes back so much of an error in a second, and is there when it is as near, m and rad.
_CORRECTION, _NEAR_M, _NEAR_RAD = 5.0, 0.001, math.radians(0.05)
#: And at the latest so much later, s.
_SETTLE_S = 1.0
#: An axis whose speed is so wrong for so long is stuck, m/s and rad/s, s; ours.
_SLIP, _SLIP_S = 0.05, 0.05
#: A place further away than this can't be meant, mm.
_FARTHEST_MM = 1e6
WHEELS = 4
#: Ours: what the battery gives at the start, V, and loses in an hour.
_FULL_V, _LOSS_V_H = 50, 1.0


class Mobility(Unit):
    """Millimetres and degrees. `start` is the place, in m and rad, that it reports when it is powered up."""

    _waits_for_unlock = True

    def __init__(self, dynamics: Dynamics, start: Place = (0.0, 0.0, 0.0)) -> None:
        super().__init__("Mobility", dynamics)
        #: Where the frame of the dynamics is in the frame that places are reported in.
        self._frame = start
        #: x, y in the frame of the dynamics, and turn: what the wheels are told, m/s and rad/s.
        self._velocity = [0.0, 0.0, 0.0]
        self._ways: deque[Way] = deque()
        self._way = Glide()
        self._arrived_at: float | None = None
        self._jog: tuple[float, float, float] | None = None
        self._jog_until = 0.0
        self._jog_timeout_ms = JOG_TIMEOUT_MS
        self._speed, self._turn = FIRST_MM_S / 1000.0, math.radians(FIRST_DEG_S)
        self._acceleration, self._turn_acceleration = FIRST_MM_S / 1000.0, math.radians(FIRST_DEG_S)
        self._slipping_from: float | None = None

    # ---- what it is asked ----

    @property
    def is_jogging(self) -> bool:
        return self._jog is not None

    @property
    def is_moving(self) -> bool:
        return bool(self._ways) or self.is_jogging or any(self._velocity)

    @property
    def mobility_state(self) -> MobilityState:
        state = self.state
        return MobilityState.BUSY if state is AxesState.JOG_BUSY else MobilityState[state.name]

    @property
    def position(self) -> Place:
        """x, y, theta as its odometry says; theta within half a turn."""
        with self._lock:
            x, y, heading = placed(self._frame, self._at)
        return 1000.0 * x, 1000.0 * y, math.degrees(math.remainder(heading, math.tau))

    @property
    def battery_v(self) -> int:
        return max(0, round(_FULL_V - _LOSS_V_H * self._seen.time / 3600.0))

    # ---- settings ----

    def set_position(self, x: float, y: float, theta: float) -> Answer:
        """Where it stands is called so from now on."""
        if not _is_place(x, y, theta):
            return Answer.OUT_OF_RANGE
        with self._lock:
            if self.is_moving:
                return Answer.WRONG_STATE
            here_seen = seen_from(self._at, (0.0, 0.0, 0.0))
            self._frame = placed((x / 1000.0, y / 1000.0, math.radians(theta)), here_seen)
            return Answer.OK

    def set_velocity(self, translation: float, rotation: float) -> Answer:
        if not (0.0 < translation <= MOST_MM_S and 0.0 < rotation <= MOST_DEG_S):
            return Answer.OUT_OF_RANGE
        with self._lock:
            self._speed, self._turn = translation / 1000.0, math.radians(rotation)
            return Answer.OK

    def set_acceleration(self, translation: float, rotation: float) -> Answer:
        if not (0.0 < translation <= MOST_MM_S and 0.0 < rotation <= MOST_DEG_S):
            return Answer.OUT_OF_RANGE
        with self._lock:
            self._acceleration, self._turn_acceleration = translation / 1000.0, math.radians(rotation)
            return Answer.OK

    def set_jog_timeout(self, timeout_ms: int) -> Answer:
        if not LEAST_JOG_TIMEOUT_MS <= timeout_ms <= MOST_JOG_TIMEOUT_MS:
            return Answer.OUT_OF_RANGE
        self._jog_timeout_ms = timeout_ms
        return Answer.OK

    def unlock(self) -> Answer:
        """After the emergency switch was released."""
        with self._lock:
            if not self._is_locked or self._is_switch_pressed:
                return Answer.WRONG_STATE
            self._is_locked = False
            return Answer.OK

    # ---- orders ----

    def jog(self, ahead: float, left: float, turn: float) -> Answer:
        """mm/s, degrees/s in its own frame."""
        if not all(map(math.isfinite, (ahead, left, turn))):
            return Answer.OUT_OF_RANGE
        slack = 1 + 1e-9
        if math.hypot(ahead, left) > MOST_MM_S * slack or abs(turn) > MOST_DEG_S * slack:
            return Answer.TOO_FAST
        with self._lock:
            if (wrong := self.may_move()) is not Answer.OK:
                return wrong
            if self._ways:
                return Answer.WRONG_STATE
            self._jog = ahead / 1000.0, left / 1000.0, math.radians(turn)
            self._jog_until = self._seen.time + self._jog_timeout_ms / 1000.0
            self._is_told = False
            return Answer.OK

    def move_by(self, x: float, y: float, theta: float, is_continuous: bool = False) -> Answer:
        """To a place in the frame of where it is now."""
        return self._move(_is_place(x, y, theta), lambda here: [_straight(here, x, y, theta)], is_continuous)

    def move_to(self, x: float, y: float, theta: float) -> Answer:
        """To a place as `position` says it; the shorter way round."""

        def ways(here: Place) -> list[Way]:
            to = seen_from(self._frame, (x / 1000.0, y / 1000.0, math.radians(theta)))
            return [Straight(here, to[:2], math.remainder(to[2] - here[2], math.tau))]

        return self._move(_is_place(x, y, theta), ways)

    def move_around(self, x: float, y: float, angle: float) -> Answer:
        """Around a centre in the frame of where it is now."""

        def ways(here: Place) -> list[Way]:
            return [Arc(here, placed(here, (x / 1000.0, y / 1000.0, 0.0))[:2], math.radians(angle))]

        return self._move(_is_place(x, y, angle), ways)

    def move_wagon(self, x: float, y: float, is_absolute: bool = False) -> Answer:
        """Turn towards a place, then drive straight."""

        def ways(here: Place) -> list[Way]:
            place = (x / 1000.0, y / 1000.0, 0.0)
            to = (seen_from(self._frame, place) if is_absolute else placed(here, place))[:2]
            if math.dist(here[:2], to) < _NEAR_M:
                return []
            bearing = math.atan2(to[1] - here[1], to[0] - here[0])
            turn = math.remainder(bearing - here[2], math.tau)
            return [Straight(here, here[:2], turn), Straight((*here[:2], here[2] + turn), to, 0.0)]

        return self._move(_is_place(x, y, 0.0), ways)

    def _move(self, is_valid: bool, ways: Callable[[Place], Iterable[Way]], is_continuous: bool = False) -> Answer:
        if not is_valid:
            return Answer.OUT_OF_RANGE
        with self._lock:
            if (wrong := self.may_move()) is not Answer.OK:
                return wrong
            if self.is_moving and not is_continuous:
                return Answer.WRONG_STATE
            self._jog = None
            self._ways = deque(way for way in ways(self._at) if _size(way) > 1e-9)
            self._begin_way()
            self._is_told = False
            return Answer.OK

    # ---- in the thread of the dynamics ----

    @property
    def _at(self) -> Place:
        """In the frame of the dynamics, as its odometry says."""
        x, y, heading = self._seen.base.tolist()
        return x, y, heading

    def _begin_way(self) -> None:
        """With the speed that the base has along it."""
        self._way, self._arrived_at = Glide(), None
        if self._ways:
            slope = _slope(self._ways[0], 0.0)
            size = sum(part * part for part in slope)
            along = sum(part * speed for part, speed in zip(slope, self._velocity, strict=True))
            self._way.speed = max(0.0, along / size)

    def _drive(self) -> None:
        if self._is_told:
            return
        if self._jog and self._seen.time > self._jog_until:
            self._jog = None
        if self._ways:
            self._follow_way()
        elif self._jog:
            self._follow_jog(self._jog)
        else:
            self._slow(0.0, 0.0, 0.0, BRAKE_M_S2, TURN_BRAKE_RAD_S2)
        self._dynamics.base_velocity[:] = self._velocity
        self._is_told = not self.is_moving

    def _follow_way(self) -> None:
        way, length_m, turn = self._ways[0], self._ways[0].length_m, abs(self._ways[0].turn)
        speed = min(self._speed / max(length_m, 1e-9), self._turn / max(turn, 1e-9))
        acceleration = min(self._acceleration / max(length_m, 1e-9), self._turn_acceleration / max(turn, 1e-9))
        if self._is_paused:
            self._way.run(0.0, acceleration)
        else:
            self._way.go(1.0, speed, acceleration)
        share = min(self._way.at, 1.0)
        errors = [wanted - is_at for wanted, is_at in zip(way.at(share), self._at, strict=True)]
        slope = zip(_slope(way, share), errors, strict=True)
        x, y, heading = (part * self._way.speed + _CORRECTION * error for part, error in slope)
        # What is left of another motion goes as fast as the wheels allow.
        self._slow(x, y, heading, BRAKE_M_S2, TURN_BRAKE_RAD_S2)
        if self._way.at >= 1.0:
            now = self._seen.time
            self._arrived_at = now if self._arrived_at is None else self._arrived_at
            is_near = math.hypot(*errors[:2]) < _NEAR_M and abs(errors[2]) < _NEAR_RAD
            if is_near or now > self._arrived_at + _SETTLE_S:
                self._ways.popleft()
                self._begin_way()

    def _follow_jog(self, jog: tuple[float, float, float]) -> None:
        ahead, left, turn = jog
        share = min(1.0, self._speed / max(math.hypot(ahead, left), 1e-9), self._turn / max(abs(turn), 1e-9))
        x, y = turned(share * ahead, share * left, self._at[2])
        self._slow(x, y, share * turn, self._acceleration, self._turn_acceleration)
        if not any(jog) and not any(self._velocity):
            self._jog = None

    def _slow(self, x: float, y: float, turn: float, acceleration: float, turn_acceleration: float) -> None:
        """A step towards a velocity, as soon as it may have it."""
        change_x, change_y = x - self._velocity[0], y - self._velocity[1]
        share = min(1.0, acceleration * STEP_S / max(math.hypot(change_x, change_y), 1e-12))
        most = turn_acceleration * STEP_S
        change = min(max(turn - self._velocity[2], -most), most)
        self._velocity = [
            self._velocity[0] + share * change_x,
            self._velocity[1] + share * change_y,
            self._velocity[2] + change,
        ]
        if share == 1.0 and x == y == 0.0:
            self._velocity[:2] = 0.0, 0.0

    def _brake(self) -> None:
        self._is_told = False
        self._ways.clear()
        self._jog = None
        if self._slipping_from is not None:  # it must not leap when it is free again
            self._velocity, self._slipping_from = [0.0, 0.0, 0.0], None

    def _is_stuck(self) -> bool:
        wrong = np.abs(np.array(self._velocity) - self._seen.base_velocity).max()
        if wrong < _SLIP:
            self._slipping_from = None
            return False
        if self._slipping_from is None:
            self._slipping_from = self._seen.time
        return self._seen.time > self._slipping_from + _SLIP_S

    def _jam(self, on: bool) -> None:
        self._dynamics.jam(slice(0, 3), on)


def _straight(here: Place, x: float, y: float, theta: float) -> Straight:
    to = placed(here, (x / 1000.0, y / 1000.0, 0.0))
    return Straight(here, to[:2], math.radians(theta))


def _size(way: Way) -> float:
    return way.length_m + abs(way.turn)


def _slope(way: Way, share: float) -> Place:
    """How fast the place changes with the share."""
    step = 1e-6
    first, last = way.at(share - step), way.at(share + step)
    x, y, heading = ((after - before) / (2 * step) for before, after in zip(first, last, strict=True))
    return x, y, heading


def _is_place(x: float, y: float, theta: float) -> bool:
    return all(map(math.isfinite, (x, y, theta))) and max(abs(x), abs(y)) <= _FARTHEST_MM and abs(theta) <= 36_000.0
