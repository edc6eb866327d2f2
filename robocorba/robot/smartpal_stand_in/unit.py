"""What all units share: power, servo, alarms, emergency switch and pause, and the state that follows from them.

The dynamics thread calls `advance` before each step. Other threads give orders, and read the state after a step."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass

from robocorba.robot.smartpal_stand_in.codes import (
    EMERGENCY_SWITCH,
    FOLLOWING_ERROR,
    Alarm,
    AlarmType,
    AxesState,
    ReturnCode,
)
from robocorba.robot.smartpal_stand_in.dynamics import Dynamics, DynamicsState

#: Delay from switching a servo on until its unit is ready [s]. Assumed.
SERVO_ON_S = 0.3
VERSION = "RoboCorba's stand-in for SmartPal V"


@dataclass(frozen=True)
class UnitPolicy:
    """What is not documented publicly: how a unit recovers, and how exact its limits are. The defaults let the robot's
    only public client recover, which clears alarms and switches power and servos, but never unlocks the base."""

    #: Clearing the alarms of a fault switches the servo on again that the fault has switched off.
    restores_servo: bool = True
    #: Switching its power off and on unlocks the base after the emergency switch, as `unlock` does.
    unlocks_by_power: bool = True
    #: A value above a limit by this share counts as the limit: clients compute degrees from radians.
    limit_slack: float = 1e-7


class Unit(ABC):
    """One unit, bound under `name`. Each order returns OK, or why it did nothing."""

    #: Whether the unit stays locked after the emergency switch is released, until it is unlocked.
    _waits_for_unlock = False

    def __init__(self, name: str, dynamics: Dynamics) -> None:
        self.name, self._dynamics = name, dynamics
        self.policy = UnitPolicy()
        self._lock = threading.RLock()
        self._latest: DynamicsState = dynamics.state
        self._is_powered = self._is_locked = self._is_switch_pressed = self._is_paused = False
        self._jam_wanted = self._jam_applied = False
        #: Whether the unit has stopped and the dynamics has its last setpoints.
        self._is_idle = True
        self._servo_ready_at: float | None = None
        #: Timeout within which a jog must be repeated, at power-up [ms]. Assumed.
        self._jog_timeout_ms = 200
        #: Whether a fault has switched the servo off.
        self._was_servo_on = False
        self._alarms: dict[int, Alarm] = {}
        self._persistent_alarm: Alarm | None = None

    # ---- what each kind of unit implements ----

    @property
    @abstractmethod
    def is_moving(self) -> bool:
        """Whether it moves or has motions left."""

    @property
    @abstractmethod
    def is_jogging(self) -> bool:
        """Whether it follows a jog."""

    @abstractmethod
    def _drive(self) -> None:
        """Set the setpoints for the next step of the dynamics."""

    @abstractmethod
    def _brake(self) -> None:
        """Drop all orders and brake as hard as the unit can."""

    @abstractmethod
    def _is_stuck(self) -> bool:
        """Whether an axis does not follow its setpoint."""

    @abstractmethod
    def _jam(self, on: bool) -> None:
        """Block an axis, or release it."""

    def advance(self, state: DynamicsState) -> None:
        """Called in the dynamics thread before each step."""
        with self._lock:
            self._latest = state
            self._drive()

    def check(self) -> None:
        """Called every few steps in the dynamics thread."""
        with self._lock:
            if self._jam_applied != self._jam_wanted:
                self._jam_applied = self._jam_wanted
                self._jam(self._jam_applied)
            if self.is_servo_on and FOLLOWING_ERROR not in self._alarms and self._is_stuck():
                self.alarm(Alarm(FOLLOWING_ERROR, AlarmType.FAULT, "an axis does not follow its servo"))

    # ---- states ----

    @property
    def is_power_on(self) -> bool:
        return self._is_powered

    @property
    def is_servo_on(self) -> bool:
        return self._servo_ready_at is not None and self._servo_ready_at <= self._latest.time

    @property
    def state(self) -> AxesState:
        """The state as an arm reports it; other units have a subset of these states."""
        with self._lock:
            if self._is_locked:
                return AxesState.LOCKED
            if FOLLOWING_ERROR in self._alarms:
                return AxesState.STUCK
            if self._has_fault:
                return AxesState.ALARM
            if not self.is_power_on:
                return AxesState.UNPOWERED
            if not self.is_servo_on:
                return AxesState.POWERED
            if self._is_paused:
                return AxesState.PAUSED
            if self.is_jogging:
                return AxesState.JOG_BUSY
            if self.is_moving:
                return AxesState.BUSY
            return AxesState.CAUTION if self._alarms else AxesState.READY

    @property
    def _has_fault(self) -> bool:
        return any(alarm.type is not AlarmType.WARNING for alarm in self._alarms.values())

    def may_move(self) -> ReturnCode:
        """OK, or why power, servo, alarms, lock or pause forbid an order to move."""
        state = self.state
        if state in (AxesState.UNPOWERED, AxesState.POWERED):
            return ReturnCode.SERVO_OFF
        held = (AxesState.ALARM, AxesState.STUCK, AxesState.LOCKED, AxesState.PAUSED)
        return ReturnCode.WRONG_STATE if state in held else ReturnCode.OK

    # ---- orders ----

    def power_on(self) -> ReturnCode:
        with self._lock:
            if self._is_locked or self._has_fault:
                return ReturnCode.WRONG_STATE
            self._is_powered = True
            return ReturnCode.OK

    def power_off(self) -> ReturnCode:
        with self._lock:
            self.servo_off()
            self._is_powered = self._was_servo_on = False
            if self.policy.unlocks_by_power and not self._is_switch_pressed:
                self._is_locked = False
            return ReturnCode.OK

    def servo_on(self) -> ReturnCode:
        """The servo is on, and the unit ready, after SERVO_ON_S."""
        with self._lock:
            if self._is_locked or self._has_fault or not self.is_power_on:
                return ReturnCode.WRONG_STATE
            if self._servo_ready_at is None:
                self._servo_ready_at = self._latest.time + SERVO_ON_S
            return ReturnCode.OK

    def servo_off(self) -> ReturnCode:
        """Brakes hold the axes then."""
        with self._lock:
            self._halt()
            self._servo_ready_at = None
            return ReturnCode.OK

    def stop(self) -> ReturnCode:
        with self._lock:
            self._halt()
            return ReturnCode.OK

    def set_jog_timeout(self, timeout_ms: int) -> ReturnCode:
        """Within which a jog must be repeated; the limits are assumed."""
        if not 20 <= timeout_ms <= 10_000:
            return ReturnCode.OUT_OF_RANGE
        self._jog_timeout_ms = timeout_ms
        return ReturnCode.OK

    def pause(self) -> ReturnCode:
        """Pause a motion; a jog cannot be paused."""
        with self._lock:
            if self.state is not AxesState.BUSY:
                return ReturnCode.WRONG_STATE
            self._is_paused = True
            return ReturnCode.OK

    def resume(self) -> ReturnCode:
        with self._lock:
            if not self._is_paused:
                return ReturnCode.WRONG_STATE
            self._is_paused = False
            return ReturnCode.OK

    def clear_alarms(self) -> ReturnCode:
        """FAILED while a persistent alarm or the emergency switch is on."""
        with self._lock:
            if self._persistent_alarm or self._is_switch_pressed:
                return ReturnCode.FAILED
            is_to_restore = self._was_servo_on and EMERGENCY_SWITCH not in self._alarms
            self._alarms.clear()
            self._was_servo_on = False
            if is_to_restore and self.policy.restores_servo:
                self.servo_on()
            return ReturnCode.OK

    def active_alarms(self, max_count: int) -> list[Alarm]:
        """At most `max_count`, the oldest first."""
        with self._lock:
            return list(self._alarms.values())[: max(0, max_count)]

    def _halt(self) -> None:
        self._is_paused = False
        self._brake()

    # ---- faults ----

    def alarm(self, alarm: Alarm) -> None:
        """Report an alarm, of which a unit keeps 16; a fault also brakes the unit and switches its servo off."""
        with self._lock:
            if alarm.code in self._alarms or len(self._alarms) < 16:
                self._alarms[alarm.code] = alarm
            if alarm.type is not AlarmType.WARNING:
                self._was_servo_on |= self._servo_ready_at is not None
                self.servo_off()

    def set_persistent_alarm(self, alarm: Alarm | None) -> None:
        """An alarm that can't be cleared until it is set to None."""
        with self._lock:
            self._persistent_alarm = alarm
            if alarm:
                self.alarm(alarm)

    def jam(self, on: bool) -> None:
        """Block an axis against its servo, or release it."""
        with self._lock:
            self._jam_wanted = on

    def emergency_switch(self, pressed: bool) -> None:
        """Pressed: brake and lock. Released: an axes unit is unlocked; the base waits for `unlock`."""
        with self._lock:
            if pressed:
                self._is_locked = True
                self.alarm(Alarm(EMERGENCY_SWITCH, AlarmType.FAULT, "the emergency switch is pressed"))
            elif not self._waits_for_unlock:
                self._is_locked = False
            self._is_switch_pressed = pressed
