"""The high controller: turns motions into commands at a fixed rate, keeps the robot's limits, and watches over it.

One thread talks to the adaptor 50 times a second for as long as the controller runs, also while nothing moves: it is
the heartbeat in both directions. A command holds for a few ticks only, so a robot whose controller is gone stands."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from robocorba.control.adaptor import RobotAdaptor
from robocorba.control.realtime import be_punctual
from robocorba.errors.robots import AdaptorFailed, IllegalOrder, MotionFailed, RobotError, RobotLost
from robocorba.motion.motion import Motion, Wish
from robocorba.motion.robot_state import ZERO_VELOCITY, ActorCommand, RobotState, Velocity
from robocorba.spatial.frames import turned
from robocorba.spatial.grids import Floats
from robocorba.spatial.pose import Limits

TICK_S = 0.02
#: A body in the building that has stood without a motion for so long is asked and told less often, s: many robots that
#: wait are no load. The next motion begins as soon as ever.
IDLE_AFTER_S, IDLE_TICK_S = 1.0, 0.08
#: How long the robot goes on without a new command, s.
VALID_S = 0.1
#: A robot that was lost is asked for again so often, s.
RETRY_S = 0.5
#: Ticks that are so late mean that the adaptor or this process hangs, s: no adaptor's calls take as long in one tick.
HANG_LIMIT_S = 1.5
#: Whoever closes the controller waits so long for an adaptor that hangs, s.
END_LIMIT_S = 5.0
#: Ticks that `jitter_s` is the worst of, and that are kept for whoever wants them all.
JITTER_TICKS = 500
#: Nothing moves faster unless somebody allows it, m/s: from here SmartPal's wheels stand in 78 ms, and a virtual robot
#: in four steps of the simulation, so that an order to stop has 20 ms for its way.
SPEED_CAP = 0.38

_log = logging.getLogger(__name__)


class HighController:
    """limits of the base; lower, upper and speed (n,) of the joints, rad and rad/s.

    follow: is called with what was read, once a tick, by the thread that reads; may raise RobotLost. told: likewise,
    with what was read and what was written then. prepare: before each start of the adaptor; may raise RobotError.
    Everything is safe from any thread."""

    def __init__(
        self,
        adaptor: RobotAdaptor,
        limits: Limits,
        lower: Floats,
        upper: Floats,
        speed: Floats,
        follow: Callable[[RobotState], None] = lambda state: None,
        told: Callable[[RobotState, ActorCommand], None] = lambda state, command: None,
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        self._adaptor, self._limits, self._follow, self._told = adaptor, limits, follow, told
        self._prepare = prepare
        self._lower, self._upper, self._speed = lower, upper, speed
        self.speed_cap = min(SPEED_CAP, limits.speed)
        self.argv: Sequence[str] = ()
        self._lock = threading.Lock()
        self._motion: _Running | None = None
        #: That a motion has come; and when something moved last.
        self._has_come = threading.Event()
        self._moved_at = 0.0
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        #: That was told last, in the building's frame.
        self._velocity: Velocity = ZERO_VELOCITY
        self._targets = np.zeros(len(lower))
        self.is_paused = False
        #: Why the robot was stopped, empty while it was not; and whether it may be started again by itself.
        self.stopped = ""
        self._is_lost = False
        #: As it was last; replaced, never changed.
        self.state = RobotState(joints=self._targets)
        self.late_s: deque[float] = deque(maxlen=JITTER_TICKS)
        self._ticked_at = 0.0

    # ---- its life ----

    def start(self, argv: Sequence[str]) -> None:
        """Start the adaptor, and the ticks. Raises AdaptorFailed and what the adaptor's start raises."""
        self.argv = argv
        self._begin()
        self._thread = threading.Thread(target=self._run, name="high controller", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let the robot stand, and end."""
        self._closing.set()
        self._end_motion(IllegalOrder("go on", "is switched off"))
        if self._thread:
            self._thread.join(END_LIMIT_S)
        self._stop_adaptor()

    # ---- motions ----

    def move(self, motion: Motion, limit_s: float = math.inf) -> None:
        """Let the robot move, and wait for its end; `limit_s` without pauses.

        Raises MotionFailed where it does not get there; IllegalOrder where another motion runs, the robot is stopped,
        or it was stopped meanwhile; RobotLost; and whatever `cancel` was given."""
        running = _Running(motion, limit_s)
        with self._lock:
            if self.stopped:
                raise IllegalOrder("move", f"is stopped: {self.stopped}")
            if self._motion is not None:
                raise IllegalOrder("move", "is moving")
            if self._closing.is_set():
                raise IllegalOrder("move", "is switched off")
            self._motion = running
        self._has_come.set()
        running.ended.wait()  # whatever ends this controller's thread ends the motion
        if running.error:
            raise running.error

    def cancel(self, why: RobotError) -> None:
        """End the motion that runs, if one does: `move` raises `why`, the robot slows down and stands."""
        self._end_motion(why)

    def emergency_stop(self, reason: str, is_lost: bool = False) -> None:
        """Emergency: the robot stands as soon as it can, and stays so until `reset_stop`."""
        with self._lock:
            if self.stopped and not is_lost:
                self._is_lost = False  # what a person has stopped, a person lets go
                self.stopped = reason
            is_first = not self.stopped
            if is_first:
                self.stopped, self._is_lost = reason, is_lost
        self._stop_adaptor()
        if is_first:
            _log.warning("stopped: %s", reason)
        self._end_motion(_stopped(reason, is_lost))

    def reset_stop(self) -> None:
        """Start the robot again. Raises IllegalOrder where it was not stopped, and as `start` does."""
        if not self.stopped:
            raise IllegalOrder("start again", "was not stopped")
        if self._silent_s > HANG_LIMIT_S and not self._is_lost:
            raise AdaptorFailed("the adaptor still hangs")
        self._begin()

    def check_alive(self) -> None:
        """Stop a robot whose ticks do not come any more; it may come back. To be called now and then by any thread."""
        if not self.stopped and not self._closing.is_set() and self._silent_s > HANG_LIMIT_S:
            self.emergency_stop(f"the robot's adaptor or process hung for {self._silent_s:.1f} s", is_lost=True)

    def check(self) -> None:
        """Raise IllegalOrder or RobotLost where the robot is stopped."""
        if reason := self.stopped:
            raise _stopped(reason, self._is_lost)

    @property
    def targets(self) -> Floats:
        """Where the joints (n,) were told to be, rad."""
        return self._targets.copy()

    @property
    def jitter_s(self) -> float:
        """How late the latest tick of the last ten seconds was."""
        return max(list(self.late_s), default=0.0)

    # ---- in the thread of the ticks ----

    def _begin(self) -> None:
        self._prepare()
        self._adaptor.start(self.argv)
        state = RobotState()
        if not self._adaptor.read(state):
            raise AdaptorFailed("the robot was started and can't be read")
        with self._lock:
            ahead, left, turn = state.velocity
            self._velocity = *turned(ahead, left, state.heading), turn
            self._targets = state.joints.copy()
            self.state = state
            self._ticked_at = time.monotonic()
            self.stopped, self._is_lost = "", False

    def _run(self) -> None:
        be_punctual()
        due = time.monotonic()
        try:
            while not self._closing.is_set():
                due += TICK_S
                late = time.monotonic() - due
                if late > TICK_S:  # what was missed is not made up for
                    due += late
                elif late < 0.0:
                    time.sleep(-late)
                if self._rests():
                    due = time.monotonic()
                self.late_s.append(max(0.0, time.monotonic() - due))
                self.check_alive()  # the whole process may have hung: nothing goes on as if it had not
                self._ticked_at = time.monotonic()
                self._tick()
                if self.stopped and self._is_lost:
                    self._find_again()
                    due = time.monotonic()
        finally:
            self._end_motion(IllegalOrder("go on", "is switched off"))

    def _tick(self) -> None:
        if self.stopped:
            return
        state = RobotState()
        try:
            if not self._adaptor.read(state):
                return  # it is being stopped this very moment
            self._follow(state)
            self.state = state
            command = self._command(state)
            self._adaptor.write(command)
            self._told(state, command)
        except AdaptorFailed as wrong:
            self._fail(str(wrong), isinstance(wrong, RobotLost))
        except Exception as wrong:  # a fault of an adaptor must not leave a robot that drives on
            _log.exception("the adaptor failed")
            self._fail(f"{type(wrong).__name__}: {wrong}")

    def _fail(self, reason: str, is_lost: bool = False) -> None:
        if not self.stopped:  # whoever is stopping the robot lets its calls fail, and has said why
            self.emergency_stop(reason, is_lost)

    def _rests(self) -> bool:
        """Whether there is nothing to do: then it has waited until a motion came, or for a while."""
        self._has_come.clear()
        now = time.monotonic()
        if self._motion or any(self._velocity) or not self._adaptor.is_in_building:
            self._moved_at = now
        if now - self._moved_at < IDLE_AFTER_S:
            return False
        self._has_come.wait(IDLE_TICK_S - TICK_S)
        return True

    @property
    def _silent_s(self) -> float:
        return time.monotonic() - self._ticked_at

    def _stop_adaptor(self) -> None:
        try:
            self._adaptor.stop()
        except RobotError as wrong:
            _log.warning("the robot did not confirm that it stands: %s", wrong)

    def _find_again(self) -> None:
        self._closing.wait(RETRY_S)
        if self._closing.is_set() or not self._is_lost:
            return
        try:
            self._begin()
            _log.info("the robot is back")
        except RobotError as wrong:
            _log.info("the robot is not back yet: %s", wrong)

    def _command(self, state: RobotState) -> ActorCommand:
        wish = self._wish(state)
        velocity = self._limited(wish.velocity, state.heading)
        joints, velocities = wish.joints, wish.joint_velocities
        if joints is None or velocities is None:
            joints, velocities = self._targets, np.zeros(len(self._targets))
        self._targets = np.clip(joints, self._lower, self._upper) if len(joints) == len(self._lower) else joints
        if len(velocities) == len(self._speed):
            velocities = np.clip(velocities, -self._speed, self._speed)
        return ActorCommand(velocity, self._targets, velocities, VALID_S)

    def _wish(self, state: RobotState) -> Wish:
        running = self._motion
        if running is None or self.is_paused:
            if running:
                running.paused(state)
            return Wish()
        try:
            wish = running.motion.wish(state, running.elapsed(state))
            if wish is None:
                self._end_motion(None)
            elif running.elapsed(state) > running.limit_s:
                raise MotionFailed(f"not done within {running.limit_s:g} s")
            return wish or Wish()
        except MotionFailed as wrong:
            self._end_motion(wrong)
        except Exception as wrong:  # whatever a motion is: the robot must stand
            _log.exception("a motion failed")
            self._end_motion(MotionFailed(f"{type(wrong).__name__}: {wrong}"))
        return Wish()

    def _limited(self, wanted: Velocity, heading: float) -> Velocity:
        """Within the cap, and speeding up no faster than the base can: in the building's frame, since what goes
        straight there changes its direction in the frame of a robot that turns."""
        ahead, left, turn = wanted
        speed = math.hypot(ahead, left)
        if speed > self.speed_cap:
            ahead, left = ahead * self.speed_cap / speed, left * self.speed_cap / speed
        turn = min(max(turn, -self._limits.turn), self._limits.turn)
        vx, vy, turning = self._velocity
        wanted_x, wanted_y = turned(ahead, left, heading)
        dx, dy = wanted_x - vx, wanted_y - vy
        share = min(1.0, self._limits.acceleration * TICK_S / max(math.hypot(dx, dy), 1e-12))
        most = self._limits.turn_acceleration * TICK_S
        turning += min(max(turn - turning, -most), most)
        self._velocity = vx + dx * share, vy + dy * share, turning
        return *turned(self._velocity[0], self._velocity[1], -heading), turning

    def _end_motion(self, error: RobotError | None) -> None:
        with self._lock:
            running, self._motion = self._motion, None
        if running:
            running.error = error
            running.ended.set()


class _Running:
    """A motion, and how long it has run by the robot's clock."""

    def __init__(self, motion: Motion, limit_s: float) -> None:
        self.motion, self.limit_s = motion, limit_s
        self.ended = threading.Event()
        self.error: RobotError | None = None
        self._since: float | None = None
        self._seen = 0.0

    def elapsed(self, state: RobotState) -> float:
        """Seconds, without pauses; nor is a time in which no tick came and the robot stood."""
        if self._since is None:
            self._since = self._seen = state.time
        self._since += max(0.0, state.time - self._seen - VALID_S)
        self._seen = state.time
        return state.time - self._since

    def paused(self, state: RobotState) -> None:
        """Time that passes now does not count."""
        if self._since is not None:
            self._since += state.time - self._seen
            self._seen = state.time


def _stopped(reason: str, is_lost: bool) -> RobotError:
    return RobotLost(reason) if is_lost else IllegalOrder("go on", f"is stopped: {reason}")
