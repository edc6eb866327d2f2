"""The hardware adaptor: drives an actual SmartPal by the robot's public interface, and by nothing else.

The base and the arms jog: a jog ends by itself when nobody repeats it, so that the robot stands when this process
hangs, dies or is cut off. Lumbar and grippers go to where they shall be."""

from __future__ import annotations

import argparse
import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as TooLate
from typing import Any, NoReturn, Protocol

import numpy as np

from robocorba.control.adaptor import RobotAdaptor
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import AdaptorFailed
from robocorba.kinematics.smartpal import ACCELERATION, ARM, BASE, GRIP, JOINTS, LOWER, LUMBAR, SPEED, UPPER, Side
from robocorba.motion.robot_state import ActorCommand, RobotState
from robocorba.spatial.frames import turned
from robocorba.spatial.grids import Floats

#: How long the robot may take until all of its units are ready, s.
START_LIMIT_S = 10.0
_START_PAUSE_S = 0.05
#: A jog holds as long as the command that it comes from is valid, within these, s.
LEAST_JOG_S, MOST_JOG_S = 0.02, 1.0
#: How much of an error of a joint is taken back in a second.
GAIN = 6.0
#: Encoders err: below this an arm that has come is let be, rad.
_AT_REST_RAD = math.radians(0.02)
#: Lumbar and grippers are told again when their target has moved by so much, rad.
_MOVED_RAD = math.radians(0.01)
#: How much of the newest difference counts for a velocity.
_NEWEST = 0.3
#: A part that was told to move may do so for so long afterwards, s.
_MOVES_S = 3.0
#: Units whose state is asked for at each `read`: all of them have their turn in 60 ms at 50 Hz.
_CHECKED_AT_ONCE = 2
#: Calls go out side by side when one after the other they take longer, s.
_SLOW_S = 0.006
#: A unit has so long to stop; calls that go out side by side have a little more than one call, s.
_STOP_LIMIT_S, _ROUND_LIMIT_S = 0.4, 0.7
#: Odometry that is off by more since it was read last has begun anew: the robot was switched off, m and rad.
_BEGUN_ANEW_M, _BEGUN_ANEW_RAD = 0.5, 0.5

Place = tuple[float, float, float]


class SmartPalUnits(Protocol):
    """A SmartPal's units, in SI. Of every method: UnitFailed where a unit refuses, AdaptorFailed where nobody answers
    in a fraction of a second. Any thread may call."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of all units."""

    def is_ready(self, unit: str) -> bool:
        """Whether it stands and waits for orders."""

    def make_ready(self, unit: str) -> None:
        """Clear its alarms, switch power and servo on, as far as it can be done now."""

    def check(self, unit: str) -> None:
        """Raise UnitFailed unless it does what it is told."""

    def stop(self, unit: str) -> None: ...

    def place(self) -> Place: ...

    def set_place(self, x: float, y: float, heading: float) -> None: ...

    def set_base_limits(self, speed: float, turn: float, acceleration: float, turn_acceleration: float) -> None: ...

    def jog_base(self, ahead: float, left: float, turn: float) -> None: ...

    def set_jog_timeout(self, timeout_s: float) -> None: ...

    def set_arm_acceleration(self, time_s: float) -> None: ...

    def arm(self, side: Side) -> Floats: ...

    def jog_arm(self, side: Side, velocities: Floats) -> None: ...

    def lumbar(self) -> Floats: ...

    def move_lumbar(self, lower: float, upper: float, speed: float, acceleration: float) -> None: ...

    def grip(self, side: Side) -> float: ...

    def move_grip(self, side: Side, position: float, speed: float, acceleration: float) -> None: ...


class SmartPalAdaptor(RobotAdaptor):
    """connect: finds the units of the robot whose naming service listens at HOST:PORT. where: the place of the robot's
    body in the building, if it has one.

    `start` takes `--naming HOST:PORT [--pose=X,Y,HEADING]`: where the robot stands, m and rad, as it is started for the
    first time; without, that is where its body is. After that its odometry knows better."""

    def __init__(
        self, connect: Callable[[str], SmartPalUnits], where: Callable[[], Place | None] = lambda: None
    ) -> None:
        self._connect, self._where = connect, where
        self._place: Place | None = None
        self._units: SmartPalUnits | None = None
        self._jog_s = 0.0
        self._turn = 0
        self._seen: tuple[float, Floats, Floats] | None = None
        self._velocities = np.zeros(3 + len(JOINTS))
        #: By part: its last target, its last jog, where it was seen last, and how long it may move.
        self._targets: dict[str, Floats] = {}
        self._jogs: dict[str, Floats] = {}
        self._known: dict[str, Floats] = {}
        self._moves_until: dict[str, float] = {}
        self._rounds = _Rounds()

    # ---- the paper's four ----

    def start(self, argv: Sequence[str]) -> bool:
        if self._units is not None:
            return False
        given = _parse(argv)
        try:
            units = self._connect(given.naming)
        except AdaptorFailed:
            raise
        except RoboCorbaError as wrong:
            raise AdaptorFailed(str(wrong)) from None
        self._get_ready(units)
        self._set_place(units, given.pose)
        units.set_base_limits(BASE.speed, BASE.turn, BASE.acceleration, BASE.turn_acceleration)
        units.set_arm_acceleration(float((SPEED / ACCELERATION)[ARM[Side.LEFT]].max()))
        self._set_jog_timeout(units, ActorCommand().valid_s)
        self._seen, self._turn = None, 0
        self._targets, self._jogs, self._known, self._moves_until = {}, {}, {}, {}
        self._velocities[:] = 0.0
        self._rounds = _Rounds()
        self._units = units
        return True

    def stop(self) -> bool:
        """Also raises AdaptorFailed where a unit does not answer; all others were stopped then, and its jog ends."""
        units, self._units = self._units, None
        if units is None:
            return False
        self._rounds.close()
        _stop_all(units)
        return True

    def read(self, state: RobotState) -> bool:
        units = self._units
        if units is None:
            return False
        names = units.names
        checked = [names[(_CHECKED_AT_ONCE * self._turn + more) % len(names)] for more in range(_CHECKED_AT_ONCE)]
        parts = _parts(units)
        asked = self._asked(list(parts))
        self._turn += 1
        place, *answers = self._rounds.make(
            [units.place, *(parts[part] for part in asked), *(_bound(units.check, unit) for unit in checked)]
        )
        self._known.update({part: np.atleast_1d(answer) for part, answer in zip(asked, answers, strict=False)})
        joints = np.concatenate([self._known[part] for part in parts])
        self._fill(state, time.monotonic(), np.array(place), joints)
        return True

    def _asked(self, parts: list[str]) -> list[str]:
        """What moves, or may still, is asked for where it is at each tick; what stands in turns."""
        now, turn = time.monotonic(), parts[self._turn % len(parts)]
        return [
            part for part in parts if part == turn or part not in self._known or now < self._moves_until.get(part, 0.0)
        ]

    def write(self, command: ActorCommand) -> bool:
        units = self._units
        if units is None:
            return False
        if command.valid_s != self._jog_s:
            self._set_jog_timeout(units, command.valid_s)
        calls: list[Callable[[], Any]] = []
        if self._is_news("base", np.array(command.velocity)):
            calls.append(lambda: units.jog_base(*command.velocity))
        if len(command.joints):
            calls += self._joint_calls(units, command)
        try:
            self._rounds.make(calls)
        finally:
            if self._units is not units:  # stopped meanwhile, perhaps before a jog of these
                _stop_all(units)
        return self._units is units

    # ---- start ----

    def _get_ready(self, units: SmartPalUnits) -> None:
        """Raises UnitFailed or AdaptorFailed with what is in the way when the time is over."""
        deadline = time.monotonic() + START_LIMIT_S
        for unit in units.names:
            units.stop(unit)
        waiting = list(units.names)
        while True:
            for unit in waiting:
                if not units.is_ready(unit):
                    units.make_ready(unit)
            time.sleep(_START_PAUSE_S)
            waiting = [unit for unit in units.names if not units.is_ready(unit)]
            if not waiting:
                return
            if time.monotonic() > deadline:
                for unit in waiting:
                    units.check(unit)
                raise AdaptorFailed(f"{', '.join(waiting)} did not get ready within {START_LIMIT_S:g} s")

    def _set_place(self, units: SmartPalUnits, pose: Place | None) -> None:
        if self._place is None:
            if at := pose or self._where():
                units.set_place(*at)
            return
        x, y, heading = units.place()
        turned = math.remainder(heading - self._place[2], math.tau)
        if math.dist((x, y), self._place[:2]) > _BEGUN_ANEW_M or abs(turned) > _BEGUN_ANEW_RAD:
            units.set_place(*self._place)

    def _set_jog_timeout(self, units: SmartPalUnits, valid_s: float) -> None:
        units.set_jog_timeout(min(max(valid_s, LEAST_JOG_S), MOST_JOG_S))
        self._jog_s = valid_s

    # ---- read ----

    def _fill(self, state: RobotState, now: float, place: Floats, joints: Floats) -> None:
        if self._seen is not None and now > self._seen[0]:
            before, place_before, joints_before = self._seen
            moved = place - place_before
            moved[2] = math.remainder(moved[2], math.tau)
            differences = np.concatenate((moved, joints - joints_before)) / (now - before)
            self._velocities += _NEWEST * (differences - self._velocities)
        self._seen = now, place, joints
        self._place = float(place[0]), float(place[1]), float(place[2])
        state.time, (state.x, state.y, state.heading) = now, self._place
        x, y, turn = self._velocities[:3].tolist()
        state.velocity = *turned(x, y, -state.heading), turn
        state.joints, state.joint_velocities = joints, self._velocities[3:].copy()

    # ---- write ----

    def _joint_calls(self, units: SmartPalUnits, command: ActorCommand) -> list[Callable[[], Any]]:
        wanted = np.clip(command.joints, LOWER, UPPER)
        moving = command.joint_velocities if len(command.joint_velocities) else np.zeros(len(JOINTS))
        calls: list[Callable[[], Any]] = []
        for side in Side:
            speeds = self._arm_speeds(wanted[ARM[side]], moving[ARM[side]], ARM[side])
            if self._is_news(f"{side.value} arm", speeds):
                calls.append(_bound(units.jog_arm, side, speeds))
        if self._has_moved("lumbar", wanted[LUMBAR]):
            speed, acceleration = float(SPEED[LUMBAR][0]), float(ACCELERATION[LUMBAR][0])
            calls.append(_bound(units.move_lumbar, *wanted[LUMBAR].tolist(), speed, acceleration))
        for side in Side:
            row = GRIP[side]
            if self._has_moved(f"{side.value} grip", wanted[row : row + 1]):
                target = float(wanted[row]), float(SPEED[row]), float(ACCELERATION[row])
                calls.append(_bound(units.move_grip, side, *target))
        return calls

    def _arm_speeds(self, wanted: Floats, moving: Floats, rows: slice) -> Floats:
        """What is wanted, and what takes back the error that was seen last."""
        error = np.zeros(len(wanted)) if self._seen is None else wanted - self._seen[2][rows]
        if not moving.any() and np.abs(error).max() < _AT_REST_RAD:
            return np.zeros(len(wanted))
        return np.asarray(np.clip(moving + GAIN * error, -SPEED[rows], SPEED[rows]))

    def _has_moved(self, which: str, target: Floats) -> bool:
        before = self._targets.get(which)
        if before is not None and np.abs(target - before).max() < _MOVED_RAD:
            return False
        self._targets[which] = target.copy()
        self._moves_until[which] = time.monotonic() + _MOVES_S
        return True

    def _is_news(self, which: str, speeds: Floats) -> bool:
        """A jog has to be repeated, unless it is to stand and was so before."""
        before, self._jogs[which] = self._jogs.get(which), speeds
        if speeds.any():
            self._moves_until[which] = time.monotonic() + _MOVES_S
            return True
        return before is None or bool(before.any())


class _Rounds:
    """Rounds of calls: one after the other where answers come at once, side by side where the network is slow."""

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._is_slow = self._is_closed = False

    def make(self, calls: Sequence[Callable[[], Any]]) -> list[Any]:
        """All answers; raises what the first of them raised."""
        begun = time.monotonic()
        if not self._is_slow:
            answers = []
            for call in calls:
                if self._is_closed:
                    raise AdaptorFailed("it was stopped")
                answers.append(call())
            self._is_slow = time.monotonic() - begun > _SLOW_S
            return answers
        if self._pool is None:
            self._pool = ThreadPoolExecutor(12, "smartpal")
        try:
            timed: list[Future[tuple[float, Any]]] = [self._pool.submit(_timed, call) for call in calls]
            found = [one.result(max(0.0, begun + _ROUND_LIMIT_S - time.monotonic())) for one in timed]
        except TooLate:
            raise AdaptorFailed(f"units did not answer within {_ROUND_LIMIT_S:g} s") from None
        except (CancelledError, RuntimeError):  # the pool is closed
            raise AdaptorFailed("it was stopped") from None
        self._is_slow = sum(took for took, _ in found) > _SLOW_S / 2
        return [answer for _, answer in found]

    def close(self) -> None:
        """Does not wait for calls on their way; they end by their own limits."""
        self._is_closed = True
        if self._pool:
            self._pool.shutdown(wait=False, cancel_futures=True)


def _parts(units: SmartPalUnits) -> dict[str, Callable[[], Any]]:
    """What tells where joints are, in their order."""
    return {
        **{f"{side.value} arm": _bound(units.arm, side) for side in (Side.LEFT, Side.RIGHT)},
        "lumbar": units.lumbar,
        **{f"{side.value} grip": _bound(units.grip, side) for side in (Side.LEFT, Side.RIGHT)},
    }


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    begun = time.monotonic()
    answer = call()
    return time.monotonic() - begun, answer


def _bound(call: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    return lambda: call(*arguments)


def _stop_all(units: SmartPalUnits) -> None:
    """All side by side, each in a thread of its own: none waits for another one. Raises AdaptorFailed."""
    failed: dict[str, str] = {}

    def stop(unit: str) -> None:
        try:
            units.stop(unit)
        except AdaptorFailed as wrong:
            failed[unit] = str(wrong)
        else:
            stopped.add(unit)

    stopped: set[str] = set()
    threads = [threading.Thread(target=stop, args=(unit,), name=f"stop {unit}", daemon=True) for unit in units.names]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + _STOP_LIMIT_S
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    missing = [unit for unit in units.names if unit not in stopped]
    if missing:
        raise AdaptorFailed("; ".join(failed.get(unit, f"{unit} did not stop in time") for unit in missing))


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise AdaptorFailed(f"the adaptor's arguments: {message}")


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(prog="smartpal", add_help=False, allow_abbrev=False)
    parser.add_argument("--naming", required=True, metavar="HOST:PORT")
    parser.add_argument("--pose", type=_pose, metavar="X,Y,HEADING")
    return parser.parse_args(list(argv))


def _pose(text: str) -> Place:
    with contextlib.suppress(ValueError):
        x, y, heading = map(float, text.split(","))
        if all(map(math.isfinite, (x, y, heading))):
            return x, y, heading
    raise argparse.ArgumentTypeError(f"{text[:60]!r} is not X,Y,HEADING")
