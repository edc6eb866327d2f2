"""The hardware adaptor: controls an actual SmartPal through the robot's public interface only.

Base and arms jog: a jog that is not repeated times out, so the robot stops if this process hangs, dies or loses the
network. Lumbar and grippers move to target positions."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from functools import partial
from typing import Any, Protocol

import numpy as np

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import AdaptorFailed
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame, turned
from robocorba.robot.adaptor import ArgumentParser, RobotAdaptor, frame_argument, was_reset
from robocorba.robot.kinematics.smartpal import (
    ARM,
    BASE_LIMITS,
    GRIP,
    JOINT_ACCELERATION,
    JOINT_LOWER,
    JOINT_SPEED,
    JOINT_UPPER,
    JOINTS,
    LUMBAR,
    Side,
)
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.senses import Senses
from robocorba.system.background import Background

#: Greatest timeout of a jog [s].
MAX_JOG_S = 1.0
#: Gain of the arms' position control [1/s].
GAIN = 6.0
#: Time after its last command for which a part counts as moving [s].
_MOVING_S = 3.0
#: Units that each `read` checks; at 50 Hz all six are checked within 60 ms.
_CHECKED_PER_READ = 2
#: Duration of a batch of sequential calls above which the next batches are parallel [s].
_SLOW_S = 0.006
#: Timeout for a unit to stop [s].
_STOP_LIMIT_S = 0.4
#: Timeout of a batch of parallel calls [s], longer than that of a single call.
_BATCH_LIMIT_S = 0.7


class SmartPalUnits(Protocol):
    """A SmartPal's units, in SI. Every method raises UnitFailed if a unit refuses, and AdaptorFailed if it does not
    answer within a fraction of a second. Thread-safe."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all units."""

    def is_ready(self, unit: str) -> bool:
        """Whether the unit is stopped and accepts commands."""

    def make_ready(self, unit: str) -> None:
        """Clear the unit's alarms, switch its power and servo on, as far as possible now."""

    def check(self, unit: str) -> None:
        """Raise UnitFailed unless the unit accepts commands."""

    def stop(self, unit: str) -> None: ...

    def pose(self) -> Frame:
        """Pose of the base by its odometry."""

    def set_pose(self, x: float, y: float, heading: float) -> None: ...

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
    """connect: resolves the units of the robot whose naming service listens at HOST:PORT; find_senses: what that robot
    senses, or None. body_pose: the pose of the robot's body in the building, or None. start_limit_s: timeout of `start`
    for all units to become ready [s]. last_pose: where a former process of this robot's agent has left it, or None.

    `start` takes `--naming HOST:PORT [--pose=X,Y,HEADING]`. The pose [m, rad] is the robot's at the first start, by
    default that of its body. Later starts, and a first one with `last_pose`, use the robot's odometry."""

    waits_for = "the actual robot"

    def __init__(
        self,
        connect: Callable[[str], SmartPalUnits],
        body_pose: Callable[[], Frame | None] = lambda: None,
        find_senses: Callable[[str], Senses | None] = lambda naming: None,
        start_limit_s: float = 10.0,
        last_pose: Frame | None = None,
    ) -> None:
        self._last_pose = last_pose
        self._connect, self._body_pose, self._start_limit_s = connect, body_pose, start_limit_s
        self._find_senses = find_senses
        #: The last pose read.
        self._pose: Frame | None = None
        self._units: SmartPalUnits | None = None
        self._jog_s = 0.0
        #: Number of reads since the start.
        self._reads = 0
        #: Time, pose and joints of the last read.
        self._last: tuple[float, Floats, Floats] | None = None
        self._velocities = np.zeros(3 + len(JOINTS))
        #: By part: its last target, jog and position, and until when it counts as moving.
        self._targets: dict[str, Floats] = {}
        self._jogs: dict[str, Floats] = {}
        self._positions: dict[str, Floats] = {}
        self._moving_until: dict[str, float] = {}
        self._batches = _CallBatches()

    # ---- the paper's four methods ----

    def start(self, argv: Sequence[str]) -> bool:
        if self._units is not None:
            return False
        given = _parse(argv)
        try:
            units = self._connect(given.naming)
        except AdaptorFailed:
            raise
        except RoboCorbaError as error:
            raise AdaptorFailed(str(error)) from None
        self.senses = self._find_senses(given.naming)
        self._get_ready(units)
        self._set_pose(units, given.pose)
        units.set_base_limits(
            BASE_LIMITS.speed, BASE_LIMITS.turn_speed, BASE_LIMITS.acceleration, BASE_LIMITS.turn_acceleration
        )
        units.set_arm_acceleration(float((JOINT_SPEED / JOINT_ACCELERATION)[ARM[Side.LEFT]].max()))
        self._set_jog_timeout(units, ActorCommand().valid_s)
        self._last, self._reads = None, 0
        self._targets, self._jogs, self._positions, self._moving_until = {}, {}, {}, {}
        self._velocities[:] = 0.0
        self._batches = _CallBatches()
        self._units = units
        return True

    def stop(self) -> bool:
        """Raises AdaptorFailed if a unit does not answer. All others are stopped then, and the unit's jog times out."""
        units, self._units = self._units, None
        if units is None:
            return False
        self._batches.close()
        _stop_all(units)
        return True

    def read(self, state: RobotState) -> bool:
        units = self._units
        if units is None:
            return False
        names = units.names
        first = _CHECKED_PER_READ * self._reads
        checked = [names[(first + more) % len(names)] for more in range(_CHECKED_PER_READ)]
        readers = _readers(units)
        due = self._due(list(readers))
        self._reads += 1
        pose, *answers = self._batches.call(
            [units.pose, *(readers[part] for part in due), *(partial(units.check, unit) for unit in checked)]
        )
        self._positions.update({part: np.atleast_1d(answer) for part, answer in zip(due, answers, strict=False)})
        joints = np.concatenate([self._positions[part] for part in readers])
        self._update(state, time.monotonic(), np.array(pose), joints)
        return True

    def _due(self, parts: list[str]) -> list[str]:
        """Parts to read now: in each cycle those that may move, and one stopped part in turn."""
        now, turn = time.monotonic(), parts[self._reads % len(parts)]
        return [
            part
            for part in parts
            if part == turn or part not in self._positions or now < self._moving_until.get(part, 0.0)
        ]

    def write(self, command: ActorCommand) -> bool:
        units = self._units
        if units is None:
            return False
        if command.valid_s != self._jog_s:
            self._set_jog_timeout(units, command.valid_s)
        calls: list[Callable[[], Any]] = []
        if self._must_send_jog("base", np.array(command.velocity)):
            calls.append(partial(units.jog_base, *command.velocity))
        if len(command.joints):
            calls += self._joint_calls(units, command)
        try:
            self._batches.call(calls)
        finally:
            if self._units is not units:  # another thread has stopped the robot, perhaps before a jog of these
                _stop_all(units)
        return self._units is units

    # ---- start ----

    def _get_ready(self, units: SmartPalUnits) -> None:
        """Make all units ready. Raises UnitFailed or AdaptorFailed with the cause after the timeout."""
        deadline = time.monotonic() + self._start_limit_s
        for unit in units.names:
            units.stop(unit)
        waiting = list(units.names)
        while True:
            for unit in waiting:
                if not units.is_ready(unit):
                    units.make_ready(unit)
            time.sleep(0.05)
            waiting = [unit for unit in units.names if not units.is_ready(unit)]
            if not waiting:
                return
            if time.monotonic() > deadline:
                for unit in waiting:
                    units.check(unit)
                raise AdaptorFailed(f"{', '.join(waiting)} did not get ready within {self._start_limit_s:g} s")

    def _set_pose(self, units: SmartPalUnits, first_pose: Frame | None) -> None:
        """Set the odometry at the first start, and after it was reset."""
        expected = self._pose or (None if first_pose else self._last_pose)
        if expected is None:
            if pose := first_pose or self._body_pose():
                units.set_pose(*pose)
        elif was_reset(units.pose(), expected):
            units.set_pose(*expected)

    def _set_jog_timeout(self, units: SmartPalUnits, valid_s: float) -> None:
        """To the validity of the command, between the bounds of the units."""
        units.set_jog_timeout(min(max(valid_s, 0.02), MAX_JOG_S))
        self._jog_s = valid_s

    # ---- read ----

    def _update(self, state: RobotState, now: float, pose: Floats, joints: Floats) -> None:
        if self._last is not None and now > self._last[0]:
            before, pose_before, joints_before = self._last
            moved = pose - pose_before
            moved[2] = math.remainder(moved[2], math.tau)
            differences = np.concatenate((moved, joints - joints_before)) / (now - before)
            self._velocities += 0.3 * (differences - self._velocities)  # a low-pass filter
        self._last = now, pose, joints
        self._pose = float(pose[0]), float(pose[1]), float(pose[2])
        state.time, (state.x, state.y, state.heading) = now, self._pose
        x, y, turn = self._velocities[:3].tolist()
        state.velocity = *turned(x, y, -state.heading), turn
        state.joints, state.joint_velocities = joints, self._velocities[3:].copy()

    # ---- write ----

    def _joint_calls(self, units: SmartPalUnits, command: ActorCommand) -> list[Callable[[], Any]]:
        wanted = np.clip(command.joints, JOINT_LOWER, JOINT_UPPER)
        moving = command.joint_velocities if len(command.joint_velocities) else np.zeros(len(JOINTS))
        calls: list[Callable[[], Any]] = []
        for side in Side:
            speeds = self._arm_speeds(wanted[ARM[side]], moving[ARM[side]], ARM[side])
            if self._must_send_jog(f"{side.value} arm", speeds):
                calls.append(partial(units.jog_arm, side, speeds))
        if self._is_new_target("lumbar", wanted[LUMBAR]):
            speed, acceleration = float(JOINT_SPEED[LUMBAR][0]), float(JOINT_ACCELERATION[LUMBAR][0])
            lower, upper = wanted[LUMBAR].tolist()
            calls.append(partial(units.move_lumbar, lower, upper, speed, acceleration))
        for side in Side:
            row = GRIP[side]
            if self._is_new_target(f"{side.value} grip", wanted[row : row + 1]):
                target = float(wanted[row]), float(JOINT_SPEED[row]), float(JOINT_ACCELERATION[row])
                calls.append(partial(units.move_grip, side, *target))
        return calls

    def _arm_speeds(self, wanted: Floats, moving: Floats, rows: slice) -> Floats:
        """The commanded velocities, plus position control by the last read joints, but for a deadband of 0.02 degrees,
        since encoders are noisy."""
        error = np.zeros(len(wanted)) if self._last is None else wanted - self._last[2][rows]
        if not moving.any() and np.abs(error).max() < math.radians(0.02):
            return np.zeros(len(wanted))
        return np.asarray(np.clip(moving + GAIN * error, -JOINT_SPEED[rows], JOINT_SPEED[rows]))

    def _is_new_target(self, part: str, target: Floats) -> bool:
        """Whether lumbar or grippers get a new move: for a change of 0.01 degrees."""
        before = self._targets.get(part)
        if before is not None and np.abs(target - before).max() < math.radians(0.01):
            return False
        self._targets[part] = target.copy()
        self._moving_until[part] = time.monotonic() + _MOVING_S
        return True

    def _must_send_jog(self, part: str, speeds: Floats) -> bool:
        """Whether to send a jog of this part: jogs are repeated, except those of zero speed."""
        before, self._jogs[part] = self._jogs.get(part), speeds
        if speeds.any():
            self._moving_until[part] = time.monotonic() + _MOVING_S
            return True
        return before is None or bool(before.any())


class _CallBatches:
    """Makes batches of calls: sequential ones on a fast network, parallel ones on a slow network."""

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._is_slow = self._is_closed = False

    def call(self, calls: Sequence[Callable[[], Any]]) -> list[Any]:
        """The answers of all calls; raises the first call's error."""
        began = time.monotonic()
        if not self._is_slow:
            answers = []
            for call in calls:
                if self._is_closed:
                    raise AdaptorFailed("it was stopped")
                answers.append(call())
            self._is_slow = time.monotonic() - began > _SLOW_S
            return answers
        if self._pool is None:
            self._pool = ThreadPoolExecutor(12, "smartpal")
        try:
            futures: list[Future[tuple[float, Any]]] = [self._pool.submit(_timed, call) for call in calls]
            timed_answers = [future.result(max(0.0, began + _BATCH_LIMIT_S - time.monotonic())) for future in futures]
        except FutureTimeout:
            raise AdaptorFailed(f"units did not answer within {_BATCH_LIMIT_S:g} s") from None
        except (CancelledError, RuntimeError):  # the pool is closed
            raise AdaptorFailed("it was stopped") from None
        self._is_slow = sum(took for took, _ in timed_answers) > _SLOW_S / 2
        return [answer for _, answer in timed_answers]

    def close(self) -> None:
        """Does not wait for pending calls; they end by their own timeouts."""
        self._is_closed = True
        if self._pool:
            self._pool.shutdown(wait=False, cancel_futures=True)


def _readers(units: SmartPalUnits) -> dict[str, Callable[[], Any]]:
    """By part, in the order of the joints: the call that reads its positions."""
    return {
        **{f"{side.value} arm": partial(units.arm, side) for side in (Side.LEFT, Side.RIGHT)},
        "lumbar": units.lumbar,
        **{f"{side.value} grip": partial(units.grip, side) for side in (Side.LEFT, Side.RIGHT)},
    }


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    began = time.monotonic()
    answer = call()
    return time.monotonic() - began, answer


def _stop_all(units: SmartPalUnits) -> None:
    """Stop all units in parallel, each in its own thread, so that none waits for another. Raises AdaptorFailed."""
    failures = {unit: f"{unit} did not stop within {_STOP_LIMIT_S:g} s" for unit in units.names}

    def stop(unit: str) -> None:
        try:
            units.stop(unit)
        except AdaptorFailed as error:
            failures[unit] = str(error)
        else:
            del failures[unit]

    threads = [
        Background(f"stop {unit}", partial(stop, unit), partial(failures.__setitem__, unit)) for unit in units.names
    ]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + _STOP_LIMIT_S
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    if reasons := list(failures.values()):
        raise AdaptorFailed("; ".join(reasons))


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = ArgumentParser()
    parser.add_argument("--naming", required=True, metavar="HOST:PORT")
    parser.add_argument("--pose", type=frame_argument, metavar="X,Y,HEADING")
    return parser.parse_args(list(argv))
