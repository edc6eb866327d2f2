"""What all units have: power, servo, alarms, the emergency switch, pause; and the state that comes of them.

The thread of the dynamics calls `advance` for each step; whoever calls the unit leaves an order and reads what was so
after the last step."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod

from robocorba.smartpal.codes import EMERGENCY_SWITCH, FOLLOWING_ERROR, Alarm, AlarmType, Answer, AxesState
from robocorba.smartpal.dynamics import Dynamics, Snapshot

#: A servo needs so long until its unit is ready, s; ours.
SERVO_ON_S = 0.3
#: A jog holds so long at power-up, and may be set to hold, ms; ours.
JOG_TIMEOUT_MS, LEAST_JOG_TIMEOUT_MS, MOST_JOG_TIMEOUT_MS = 200, 20, 10_000
#: Alarms that a unit keeps; more of other codes are not noted.
MOST_ALARMS = 16
VERSION = "RoboCorba's stand-in for SmartPal V"


class Unit(ABC):
    """One unit, under the `name` that it is bound as. Each order answers OK, or why nothing was done."""

    def __init__(self, name: str, dynamics: Dynamics) -> None:
        self.name, self._dynamics = name, dynamics
        self._lock = threading.RLock()
        self._seen: Snapshot = dynamics.seen
        self._is_powered = self._is_locked = self._is_switch_pressed = self._is_paused = False
        self._is_jammed = self._jammed = False
        #: Whether the dynamics knows already that the unit stands.
        self._is_told = True
        self._servo_from: float | None = None
        self._alarms: dict[int, Alarm] = {}
        self._lasting: Alarm | None = None

    # ---- what a unit does by itself ----

    @property
    @abstractmethod
    def is_moving(self) -> bool:
        """Whether it does anything but stand."""

    @property
    @abstractmethod
    def is_jogging(self) -> bool:
        """Whether it moves as a jog says."""

    @abstractmethod
    def _drive(self) -> None:
        """Tell the dynamics what to do in the next step."""

    @abstractmethod
    def _brake(self) -> None:
        """Forget what was ordered, and halt as hard as the unit can."""

    @abstractmethod
    def _is_stuck(self) -> bool:
        """Whether it does not follow its servo."""

    @abstractmethod
    def _jam(self, on: bool) -> None:
        """Hold an axis, or let it go."""

    def advance(self, seen: Snapshot) -> None:
        """Before each step of the dynamics."""
        with self._lock:
            self._seen = seen
            self._drive()

    def check(self) -> None:
        """Now and then, in the same thread."""
        with self._lock:
            if self._jammed != self._is_jammed:
                self._jammed = self._is_jammed
                self._jam(self._jammed)
            if self.is_servo_on and FOLLOWING_ERROR not in self._alarms and self._is_stuck():
                self.alarm(Alarm(FOLLOWING_ERROR, AlarmType.FAULT, "it does not follow its servo"))

    # ---- states ----

    @property
    def is_power_on(self) -> bool:
        return self._is_powered

    @property
    def is_servo_on(self) -> bool:
        return self._servo_from is not None and self._servo_from <= self._seen.time

    @property
    def state(self) -> AxesState:
        """Of an arm; other units have those of these states that they know."""
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

    def may_move(self) -> Answer:
        """Whether an order to move can be taken, as far as power, servo, alarms and pauses go."""
        state = self.state
        if state in (AxesState.UNPOWERED, AxesState.POWERED):
            return Answer.SERVO_OFF
        held = (AxesState.ALARM, AxesState.STUCK, AxesState.LOCKED, AxesState.PAUSED)
        return Answer.WRONG_STATE if state in held else Answer.OK

    # ---- orders ----

    def power_on(self) -> Answer:
        with self._lock:
            if self._is_locked or self._has_fault:
                return Answer.WRONG_STATE
            self._is_powered = True
            return Answer.OK

    def power_off(self) -> Answer:
        with self._lock:
            self.servo_off()
            self._is_powered = False
            return Answer.OK

    def servo_on(self) -> Answer:
        """It is on, and the unit ready, SERVO_ON_S later."""
        with self._lock:
            if self._is_locked or self._has_fault or not self.is_power_on:
                return Answer.WRONG_STATE
            if self._servo_from is None:
                self._servo_from = self._seen.time + SERVO_ON_S
            return Answer.OK

    def servo_off(self) -> Answer:
        """Brakes hold it then."""
        with self._lock:
            self._halt()
            self._servo_from = None
            return Answer.OK

    def stop(self) -> Answer:
        with self._lock:
            self._halt()
            return Answer.OK

    def pause(self) -> Answer:
        """Wait on the way of a motion; not of a jog."""
        with self._lock:
            if self.state is not AxesState.BUSY:
                return Answer.WRONG_STATE
            self._is_paused = True
            return Answer.OK

    def resume(self) -> Answer:
        with self._lock:
            if not self._is_paused:
                return Answer.WRONG_STATE
            self._is_paused = False
            return Answer.OK

    def clear_alarms(self) -> Answer:
        """FAILED while what the alarm is about lasts."""
        with self._lock:
            if self._lasting or self._is_switch_pressed:
                return Answer.FAILED
            self._alarms.clear()
            return Answer.OK

    def active_alarms(self, most: int) -> list[Alarm]:
        """At most so many, the oldest first."""
        with self._lock:
            return list(self._alarms.values())[: max(0, most)]

    def _halt(self) -> None:
        self._is_paused = False
        self._brake()

    # ---- what happens to it ----

    def alarm(self, alarm: Alarm) -> None:
        """A fault brakes it and takes its servo off."""
        with self._lock:
            if alarm.code in self._alarms or len(self._alarms) < MOST_ALARMS:
                self._alarms[alarm.code] = alarm
            if alarm.type is not AlarmType.WARNING:
                self.servo_off()

    def lasting_alarm(self, alarm: Alarm | None) -> None:
        """One that can't be cleared until there is none any more."""
        with self._lock:
            self._lasting = alarm
            if alarm:
                self.alarm(alarm)

    def jam(self, on: bool) -> None:
        """An axis of it does not move, whatever its servo does."""
        with self._lock:
            self._is_jammed = on

    def emergency_switch(self, pressed: bool) -> None:
        """It brakes and is locked; an axis unit is free again when the switch is, a base when it is unlocked too."""
        with self._lock:
            if pressed:
                self._is_locked = True
                self.alarm(Alarm(EMERGENCY_SWITCH, AlarmType.FAULT, "the emergency switch is pressed"))
            elif not self._waits_for_unlock:
                self._is_locked = False
            self._is_switch_pressed = pressed

    _waits_for_unlock = False
