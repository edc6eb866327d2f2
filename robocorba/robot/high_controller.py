"""The high controller: a 50 Hz control loop that turns motions into commands within the robot's limits, and monitors
the robot.

One thread reads the adaptor and writes to it in each control cycle (tick), also while nothing moves: this is the
heartbeat in both directions. A command is valid for a few ticks only, so a robot that loses its controller stops."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import AdaptorFailed, IllegalOrder, MotionFailed, RobotError, RobotHeld, RobotLost
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import turned
from robocorba.robot.adaptor import SIMULATION_SERVER, RobotAdaptor
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, JOINT_LOWER, JOINT_SPEED, JOINT_UPPER
from robocorba.robot.motion.motion import Motion, MotionCommand
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, ActorCommand, RobotState, Velocity
from robocorba.robot.protective_field import ProtectiveField
from robocorba.robot.realtime import use_realtime_scheduling
from robocorba.robot.senses import Senses
from robocorba.simulation.attended_time import AttendedTime
from robocorba.simulation.registry import LEASE_S
from robocorba.system.background import Background
from robocorba.system.backoff import Backoff
from robocorba.system.stop_latch import StopLatch

#: Period of the control loop [s].
TICK_S = 0.02
#: Validity of a command [s].
VALID_S = 0.1
#: Default speed limit [m/s]: from it SmartPal's wheels stop in 78 ms and a virtual robot in four simulation steps,
#: which leaves a stop command 20 ms to arrive.
SPEED_CAP = 0.38
#: What a defect raises; SystemExit, because libraries of robots call sys.exit.
DEFECTS = (Exception, SystemExit)

Answer = TypeVar("Answer")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Timing:
    """Times of a control loop [s], beside its period."""

    #: Time without a motion after which a stationary virtual robot is idle.
    idle_after_s: float = 1.0
    #: Period while the robot is idle, so that many waiting robots are little load. A new motion ends it immediately.
    idle_tick_s: float = 0.08
    #: Period while it is idle, rests and is not moved by others: a quarter of the lease of a robot in the building,
    #: which reading renews. `refresh` ends it immediately.
    rest_tick_s: float = 0.5
    #: Timeout of `refresh`.
    refresh_limit_s: float = 0.2
    #: Time without a tick after which what the control loop waits for counts as hanging.
    hang_limit_s: float = 1.5
    #: The same for the simulation server: a session's calls end sooner (`remote_session.PATIENCE_S`). The robot stands
    #: meanwhile, since its last command expires.
    server_limit_s: float = 7.0
    #: Interval between checks of the control loop while a motion runs.
    check_interval_s: float = 0.5
    #: Time since the last of these checks that counts as time in which this process has run; more is a pause of it.
    longest_check_pause_s: float = 0.75
    #: Longest pause of this process after which a motion goes on: after the lease the robot's place may be another's.
    pause_limit_s: float = LEASE_S
    #: Timeout of `close` for an adaptor that hangs, and of `reset_stop` for a start of the adaptor that goes on.
    end_limit_s: float = 5.0


@dataclass
class Callbacks:
    """What a control loop calls. Its thread calls `on_state`, `on_command` and `on_held`."""

    #: After each read; it calls the simulation server. May raise RobotLost.
    on_state: Callable[[RobotState], None] = lambda state: None
    #: After each write, with the state that was read before it.
    on_command: Callable[[RobotState, ActorCommand], None] = lambda state, command: None
    #: Before each start of the adaptor; may raise RobotError.
    before_start: Callable[[], None] = lambda: None
    #: Whether nothing is under way for which the robot has to be read often.
    rests: Callable[[], bool] = lambda: False
    #: After each change of `stopped`; must not block.
    on_stop: Callable[[], None] = lambda: None
    #: When an emergency stop holds the robot, with the reason; by default `emergency_stop`.
    on_held: Callable[[str], None] | None = None


class HighController:
    """Controls a robot with SmartPal's base and joints, or without joints. stops: the latch of the robot's stops, which
    outlives this controller. Thread-safe.

    Nothing moves while a stop holds, or while the robot is lost. These are two latches: a reset ends the stops that it
    has seen, and a start of the adaptor ends the losses that were known when it began. What comes in between stops the
    adaptor as soon as it has started.

    A pause of the whole process, such as by a debugger, is no fault of the adaptor. After a short one the motion goes
    on from standstill, since the last command has expired; so it does after a silence of the simulation server."""

    def __init__(
        self,
        adaptor: RobotAdaptor,
        stops: StopLatch | None = None,
        calls: Callbacks | None = None,
        timing: Timing = Timing(),
        field: ProtectiveField | None = None,
    ) -> None:
        self._adaptor, self._timing, self._calls, self._field = adaptor, timing, calls or Callbacks(), field
        self.speed_cap = min(SPEED_CAP, BASE_LIMITS.speed)
        self.argv: Sequence[str] = ()
        self._stops = stops or StopLatch()
        #: A robot that was lost is restarted once it answers.
        self._losses = StopLatch()
        #: The numbers of the stops and losses for which the adaptor was stopped.
        self._halted = (0, 0)
        #: Why it is stopped, as the log says; one stop comes by several ways.
        self._logged = ""
        self._lock = threading.Lock()
        #: Held during all calls of the adaptor except `stop`.
        self._adaptor_in_use = threading.Lock()
        #: Whether the adaptor is being started: then no tick is due.
        self._is_beginning = False
        self._motion: _RunningMotion | None = None
        #: Set to end an idle period, such as when a motion begins.
        self._woken = threading.Event()
        #: Set by each tick, for `refresh`.
        self._ticked = threading.Event()
        self._moved_at = 0.0
        #: Whether the last tick was one of an idle robot.
        self.is_idle = False
        self._closing = threading.Event()
        self._loop: threading.Thread | None = None
        #: Whether the control loop runs; False after a defect of it until a reset.
        self._is_looping = False
        #: Whose answer the control loop waits for; empty between calls.
        self._waits_for = ""
        #: Why the last attempt to reconnect to a lost robot failed, and how many did so in a row.
        self._reconnect_problem, self._reconnect_failures = "", 0
        #: What the motion waits for, by its last command; and when the robot's clock advanced last [s, monotonic].
        self._awaited, self._advanced_at = "", 0.0
        #: The last commanded velocity, in the building's frame.
        self._velocity: Velocity = ZERO_VELOCITY
        self._targets = np.zeros(len(JOINT_LOWER))
        self.is_paused = False
        #: Whether the adaptor has confirmed that the robot behind it was stopped.
        self.is_stop_confirmed = False
        #: The last state; replaced, never changed.
        self.state = RobotState(joints=self._targets)
        #: Lateness of the ticks of the last ten seconds [s].
        self.late_s: deque[float] = deque(maxlen=500)
        self._read_at = 0.0
        #: How long the ticks of the last second took [s]; when this one began, and how long after the one before it.
        self._took_s: deque[float] = deque(maxlen=50)
        self._began = self._since_last_s = 0.0
        #: When the last command was written [s, monotonic].
        self._written_at = -math.inf
        #: The time in which this process has run.
        self._awake = AttendedTime(longest_pause_s=timing.longest_check_pause_s)
        #: When the last tick began, or the next one is due: by `_awake`, and by the clock.
        self._ticked_at = self._ticked_at_clock = 0.0

    # ---- start and end ----

    def start(self, argv: Sequence[str]) -> None:
        """Start the adaptor and the control loop. Raises AdaptorFailed and what the adaptor's start raises."""
        self.argv = argv
        with self._adaptor_in_use:
            self._begin()
        if self._field:
            self._field.start(self.cancel)
        self._start_loop()

    def close(self) -> None:
        """Stop the robot, and end the control loop."""
        self._closing.set()
        self._woken.set()
        self._end_motion(IllegalOrder("continue", "is switched off"))
        if self._loop:
            self._loop.join(self._timing.end_limit_s)
        self._stop_adaptor()
        if self._field:
            self._field.close()

    @property
    def is_closed(self) -> bool:
        return self._closing.is_set()

    @property
    def senses(self) -> Senses | None:
        """What the robot behind the adaptor senses; None without sensors."""
        return self._adaptor.senses

    # ---- motions ----

    def move(self, motion: Motion) -> None:
        """Run a motion, and wait for its end.

        Raises MotionFailed if the robot does not reach the target; IllegalOrder if another motion runs, or the robot is
        or gets stopped; RobotLost; and the error given to `cancel`."""
        running = _RunningMotion(motion)
        with self._lock:
            if reason := self.stopped:
                raise IllegalOrder("move", f"is stopped: {reason}")
            if self._motion is not None:
                raise IllegalOrder("move", "is moving")
            if self._closing.is_set():
                raise IllegalOrder("move", "is switched off")
            self._motion = running
        self._woken.set()
        while not running.ended.wait(self._timing.check_interval_s):
            self.check_alive()
        if running.error:
            raise running.error

    def cancel(self, why: RobotError) -> None:
        """End the running motion, if any, so that `move` raises `why`; the robot slows down and stops."""
        self._end_motion(why)

    @property
    def stopped(self) -> str:
        """Why the robot is stopped or lost, or empty."""
        reason, problem = self._losses.reason, self._reconnect_problem
        if reason and problem and problem != reason:
            reason = f"{reason}; it can't reconnect: {problem}"
        return self._stops.reason or reason

    @property
    def is_lost(self) -> bool:
        """Whether it is stopped only until it answers again."""
        return self._losses.is_on and not self._stops.is_on

    def emergency_stop(self, reason: str) -> None:
        """Stop the robot as soon as possible, until `reset_stop`."""
        self._stops.stop(reason)
        self.halt()

    def lose(self, reason: str) -> None:
        """Stop the robot, which does not answer, until it answers again."""
        self._losses.stop(reason)
        self.halt()

    def halt(self) -> None:
        """Stop the adaptor after a stop or a loss. The control loop does so, too, if its latch was set elsewhere."""
        self._halted, reason, is_lost = self._numbers, self.stopped, self.is_lost
        if reason and reason != self._logged:
            self._logged = reason
            _log.warning("stopped: %s", reason)
        self._stop_adaptor()
        if reason:
            self._end_motion(_stopped(reason, is_lost))
        self._calls.on_stop()

    def reset_stop(self, seen: int | None = None, end: Callable[[int], None] | None = None) -> None:
        """Restart the robot, and end the stops up to number `seen` of their latch, by default all until now. end: ends
        them once the robot answers; what it raises leaves the robot stopped. A control loop that has ended by a defect
        is started again.

        Raises IllegalOrder if it is not stopped, or is stopped again meanwhile; and as `start` does."""
        seen = self._stops.number if seen is None else seen
        if not self.stopped:
            raise IllegalOrder("restart", "was not stopped")
        is_silent = self._is_looping and self._silent_s > self._limit_s and not self.is_lost
        if is_silent or not self._adaptor_in_use.acquire(timeout=self._timing.end_limit_s):
            raise AdaptorFailed(f"it still hangs: {self._hang}")
        try:
            self._begin(seen, end or self._stops.end)
            self._start_loop()
        finally:
            self._adaptor_in_use.release()
        if reason := self.stopped:
            raise IllegalOrder("restart", f"was stopped again: {reason}")

    def check_alive(self) -> None:
        """Stop the robot if the control loop hangs; it restarts once the loop continues. Any thread may call this. One
        has to every `check_interval_s`, as `move` does, to show that the process runs: its pauses are no hang."""
        self._awake.attend()
        self._check_hang()
        self._halt_if_due()

    @property
    def awaited(self) -> str:
        """What the robot, or its motion, waits for; empty if neither does."""
        limit_s = self._timing.check_interval_s
        if (whom := self._waits_for) and self._silent_s > limit_s:
            return f"{whom}, which does not answer"
        if time.monotonic() - self._advanced_at > limit_s + self._timing.rest_tick_s:
            return f"{self._adaptor.waits_for}, whose time stands"
        return self._awaited

    def check(self) -> None:
        """Raise IllegalOrder or RobotLost if the robot is stopped."""
        if reason := self.stopped:
            raise _stopped(reason, self.is_lost)

    def wake(self) -> None:
        """Make the next tick now if the robot is idle."""
        self._woken.set()

    def refresh(self) -> None:
        """Wait until the state is as new as that of an idle robot; it is older if the robot rests. Returns after
        `refresh_limit_s` at the latest, and at once for a robot that is stopped."""
        if self.stopped or self._closing.is_set() or time.monotonic() - self._read_at < 2 * self._timing.idle_tick_s:
            return
        self._ticked.clear()
        self._woken.set()
        self._ticked.wait(self._timing.refresh_limit_s)

    @property
    def targets(self) -> Floats:
        """The joints' last targets (n,) [rad]."""
        return self._targets.copy()

    @property
    def jitter_s(self) -> float:
        """The greatest lateness of a tick in the last ten seconds [s]."""
        return max(list(self.late_s), default=0.0)

    # ---- the control loop ----

    def _begin(self, seen: int = 0, end: Callable[[int], None] | None = None) -> None:
        """Start the adaptor; end the losses until now, and by `end` the stops up to number `seen`. If anything still
        holds the robot, the adaptor is stopped again. Requires `_adaptor_in_use`."""
        losses, was_confirmed = self._losses.number, self.is_stop_confirmed
        self._is_beginning, self.is_stop_confirmed = True, False
        try:
            if state := self._start_adaptor():
                self._velocity = _velocity(state)
                self._targets = state.joints.copy()
                self._note_state(state)
            if end:
                end(seen)
            self._losses.end(losses)
            self._reconnect_problem, self._reconnect_failures = "", 0
        except BaseException:
            if not self._stop_adaptor():
                self.is_stop_confirmed |= was_confirmed
            raise
        finally:
            self._note_tick()
            self._is_beginning = False
        if self.stopped or self._closing.is_set():
            self._stop_adaptor()
        else:
            self._logged = ""
        self._woken.set()
        self._calls.on_stop()

    def _start_adaptor(self) -> RobotState | None:
        """Returns the state that it reads first; None if it was stopped before that."""
        self._calls.before_start()
        state = RobotState()
        try:
            self._adaptor.start(self.argv)
            is_read = self._adaptor.read(state)
        except RoboCorbaError:
            raise
        except DEFECTS as error:  # of an adaptor, which may be anybody's
            _log.exception("the adaptor failed to start")
            raise AdaptorFailed(f"{type(error).__name__}: {error}") from error
        if not is_read and not self._stops.is_on:
            raise AdaptorFailed("the adaptor has started but can't be read")
        return state if is_read else None

    def _start_loop(self) -> None:
        """Start the control loop unless it runs."""
        if not self._is_looping:
            self._is_looping = True
            self._loop = Background("high controller", self._run, self._loop_failed)
            self._loop.start()

    def _loop_failed(self, reason: str) -> None:
        """The loop has ended by a defect; the next reset starts another one."""
        self._is_looping = False
        self.emergency_stop(reason)

    def _run(self) -> None:
        use_realtime_scheduling()
        due = time.monotonic()
        while not self._closing.is_set():
            due += TICK_S
            late = time.monotonic() - due
            if late > TICK_S:  # missed ticks are skipped
                due += late
            elif late < 0.0:
                time.sleep(-late)
            self.is_idle = self._wait_if_idle()
            if self.is_idle:
                due = time.monotonic()
            self.late_s.append(max(0.0, time.monotonic() - due))
            self._check_hang()
            if (pause_s := time.monotonic() - self._ticked_at_clock) > self._timing.pause_limit_s and not self.stopped:
                self.lose(f"the robot's process was paused for {pause_s:.1f} s")
            self._tick()
            self._ticked.set()
            if self.is_lost:
                self._reconnect()
                due = time.monotonic()

    def _note_tick(self, due_in_s: float = 0.0) -> None:
        self._ticked_at, self._ticked_at_clock = self._awake() + due_in_s, time.monotonic() + due_in_s

    def _check_hang(self) -> None:
        is_held = self._is_beginning or self._closing.is_set() or bool(self.stopped)
        if not is_held and self._silent_s > self._limit_s:
            self.lose(self._hang)

    @property
    def _limit_s(self) -> float:
        """Longest time without a tick [s]."""
        return self._timing.server_limit_s if self._waits_for == SIMULATION_SERVER else self._timing.hang_limit_s

    @property
    def _hang(self) -> str:
        """Who keeps the control loop waiting, a sentence."""
        if whom := self._waits_for:
            return f"{whom} did not answer for {self._silent_s:.1f} s"
        return f"the robot's process hung for {self._silent_s:.1f} s"

    def _answer_of(self, waits_for: str, call: Callable[..., Answer], *arguments: object) -> Answer:
        """The answer to a call in a tick. waits_for: what may keep it waiting."""
        self._waits_for, began, began_clock = waits_for, self._awake(), time.monotonic()
        try:
            answer = call(*arguments)
            self._check_hang()
            if waits_for == SIMULATION_SERVER:  # what follows in the tick has its whole limit
                self._ticked_at += self._awake() - began
                self._ticked_at_clock += time.monotonic() - began_clock
            return answer
        finally:
            self._waits_for = ""

    def _tick(self) -> None:
        self._note_tick()
        with self._adaptor_in_use:
            if self.stopped:
                self._halt_if_due()
                if self.is_stop_confirmed:  # it is not read until it is started again
                    still = np.zeros_like(self.state.joint_velocities)
                    self.state = replace(self.state, velocity=ZERO_VELOCITY, joint_velocities=still)
            else:
                self._use_adaptor()

    def _use_adaptor(self) -> None:
        state, robot = RobotState(), self._adaptor.waits_for
        before, self._began = self._began, time.monotonic()
        self._since_last_s = min(max(self._began - before, TICK_S), VALID_S)
        try:
            if not self._answer_of(robot, self._adaptor.read, state):
                if not (self.stopped or self._closing.is_set()):  # by a late halt after a stop that has ended meanwhile
                    self.lose("its adaptor was stopped")
                return
            read_at = time.monotonic()
            self._answer_of(SIMULATION_SERVER, self._calls.on_state, state)
            now = time.monotonic()
            if any(self._velocity) and now - self._written_at > VALID_S:  # the last command has expired
                self._velocity = _velocity(state) if now - read_at < VALID_S else ZERO_VELOCITY
            self._note_state(state)
            command = self._command(state)
            self._written_at = time.monotonic()
            self._answer_of(robot, self._adaptor.write, command)
            self._took_s.append(time.monotonic() - self._began)
            self._calls.on_command(state, command)
        except RobotHeld as error:
            if not self.stopped:  # a stop makes the adaptor's calls fail, and has set its own reason
                (self._calls.on_held or self.emergency_stop)(str(error))
        except RobotLost as error:
            if not self.stopped:
                self.lose(str(error))
        except AdaptorFailed as error:
            self._fail(str(error))
        except DEFECTS as error:  # a defect of an adaptor must not leave the robot driving
            _log.exception("the adaptor failed")
            self._fail(f"{type(error).__name__}: {error}")

    def _note_state(self, state: RobotState) -> None:
        now = time.monotonic()
        if state.time != self.state.time:
            self._advanced_at = now
        self.state, self._read_at = state, now

    def _halt_if_due(self) -> None:
        """After a stop of the latch that was set elsewhere."""
        if self.stopped and self._halted != self._numbers:
            self.halt()

    def _fail(self, reason: str) -> None:
        if not self.stopped:
            self.emergency_stop(reason)

    def _wait_if_idle(self) -> bool:
        """If the robot is idle, wait for the rest of its longer tick or until it is woken; returns whether it was."""
        self._woken.clear()
        now = time.monotonic()
        if self._motion or any(self._velocity) or not self._adaptor.is_in_building:
            self._moved_at = now
        is_stopped = self._stops.is_on  # ticks have no effect
        if self._closing.is_set() or (now - self._moved_at < self._timing.idle_after_s and not is_stopped):
            return False
        # By others, such as by an elevator or when it is pushed, above 1 mm/s or 0.001 rad/s.
        is_moved = max(map(abs, self.state.velocity)) > 0.001
        rests = self._calls.rests() and not is_moved
        pause_s = (self._timing.rest_tick_s if rests else self._timing.idle_tick_s) - TICK_S
        self._note_tick(pause_s)
        self._woken.wait(pause_s)
        self._ticked_at = min(self._ticked_at, self._awake())
        self._ticked_at_clock = min(self._ticked_at_clock, time.monotonic())
        return True

    @property
    def _numbers(self) -> tuple[int, int]:
        return self._stops.number, self._losses.number

    @property
    def _silent_s(self) -> float:
        """Time without a tick in which this process has run [s]."""
        return self._awake() - self._ticked_at

    def _stop_adaptor(self) -> bool:
        """Returns whether it had to be stopped; else it was stopped before, or is being stopped."""
        try:
            if not self._adaptor.stop():
                return False
            self.is_stop_confirmed = True
        except RobotError as error:
            self.is_stop_confirmed = False
            _log.warning("the robot did not confirm the stop: %s", error)
        except DEFECTS:
            self.is_stop_confirmed = False
            _log.exception("the adaptor failed to stop")
        return True

    def _reconnect(self) -> None:
        self._closing.wait(Backoff(0.5, 2.0, 1.5, jitter=0.2).pause_s(self._reconnect_failures + 1))
        if self._closing.is_set() or not self.is_lost:
            return
        try:
            with self._adaptor_in_use:
                self._begin()
            _log.info("reconnected to the robot")
        except RoboCorbaError as error:
            self._reconnect_failures += 1
            if str(error) != self._reconnect_problem:
                self._reconnect_problem = str(error)
                _log.info("can't reconnect to the robot, it keeps trying: %s", error)
                self._calls.on_stop()

    def _command(self, state: RobotState) -> ActorCommand:
        wanted = self._motion_command(state)
        velocity = self._next_velocity(wanted.velocity, state)
        self._awaited = wanted.awaited or (self._field.awaited if self._field else "")
        joints, velocities = wanted.joints, wanted.joint_velocities
        if joints is None or velocities is None:
            joints, velocities = self._targets, np.zeros(len(self._targets))
        if len(joints) == len(JOINT_LOWER):
            joints = np.clip(joints, JOINT_LOWER, JOINT_UPPER)
            velocities = np.clip(velocities, -JOINT_SPEED, JOINT_SPEED)
        self._targets = joints
        return ActorCommand(velocity, self._targets, velocities, VALID_S)

    def _motion_command(self, state: RobotState) -> MotionCommand:
        running = self._motion
        if running is None or self.is_paused:
            if running:
                running.paused(state)
            return MotionCommand()
        try:
            command = running.motion.command(state, running.elapsed(state))
            if command is None:
                self._end_motion(None)
            return command or MotionCommand()
        except MotionFailed as error:
            self._end_motion(error)
        except DEFECTS as error:  # a defect of a motion must not leave the robot driving
            _log.exception("a motion failed")
            self._end_motion(MotionFailed(f"{type(error).__name__}: {error}"))
        return MotionCommand()

    def _next_velocity(self, wanted: Velocity, state: RobotState) -> Velocity:
        """What to command for a wanted velocity, within the limits and the protective field."""
        (vx, vy), turn = turned(wanted[0], wanted[1], state.heading), wanted[2]
        cap, field = self.speed_cap, self._field
        if field:
            field.observe(state, max(time.monotonic() - self._began, *self._took_s, 0.0))
            if vx or vy or any(self._velocity[:2]):
                field.attend()
            try:
                cap = min(cap, field.hold(vx, vy))
            except MotionFailed as error:
                self._end_motion(error)
                cap = 0.0
        # Where ticks are late, the base still brakes as hard as it can.
        step_s = self._since_last_s if cap < math.hypot(*self._velocity[:2]) else TICK_S
        found = self._limited(vx, vy, turn, cap, step_s)
        if field and math.hypot(*found[:2]) > field.limit(*found[:2])[0]:
            found = self._limited(0.0, 0.0, turn, 0.0, self._since_last_s)  # in the direction in which it drives
        self._velocity = found
        return *turned(found[0], found[1], -state.heading), found[2]

    def _limited(self, wanted_x: float, wanted_y: float, turn: float, cap: float, step_s: float) -> Velocity:
        """Limit a velocity to the cap and, for a step, to the base's acceleration, in the building's frame: in the
        frame of a turning robot, even a constant velocity changes its direction."""
        speed = math.hypot(wanted_x, wanted_y)
        if speed > cap:
            wanted_x, wanted_y = wanted_x * cap / speed, wanted_y * cap / speed
        turn = min(max(turn, -BASE_LIMITS.turn_speed), BASE_LIMITS.turn_speed)
        vx, vy, turning = self._velocity
        dx, dy = wanted_x - vx, wanted_y - vy
        share = min(1.0, BASE_LIMITS.acceleration * step_s / max(math.hypot(dx, dy), 1e-12))
        step = BASE_LIMITS.turn_acceleration * TICK_S
        return vx + dx * share, vy + dy * share, turning + min(max(turn - turning, -step), step)

    def _end_motion(self, error: RobotError | None) -> None:
        with self._lock:
            running, self._motion = self._motion, None
        if running:
            running.error = error
            running.ended.set()


class _RunningMotion:
    """A motion, and the time since its start by the robot's clock."""

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.ended = threading.Event()
        self.error: RobotError | None = None
        self._since: float | None = None
        self._last_time = 0.0

    def elapsed(self, state: RobotState) -> float:
        """Seconds, without pauses and without gaps between ticks in which the robot was stopped."""
        if self._since is None:
            self._since = self._last_time = state.time
        self._since += max(0.0, state.time - self._last_time - VALID_S)
        self._last_time = state.time
        return state.time - self._since

    def paused(self, state: RobotState) -> None:
        """Exclude the time since the last tick from `elapsed`."""
        if self._since is not None:
            self._since += state.time - self._last_time
            self._last_time = state.time


def _velocity(state: RobotState) -> Velocity:
    """In the building's frame."""
    return *turned(*state.velocity[:2], state.heading), state.velocity[2]


def _stopped(reason: str, is_lost: bool) -> RobotError:
    return RobotLost(reason) if is_lost else IllegalOrder("continue", f"is stopped: {reason}")
