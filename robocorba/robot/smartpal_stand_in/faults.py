"""Faults of the stand-in, switched on and off while it runs. An actual robot has no such interface."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping

from robocorba.errors.base import FieldError
from robocorba.errors.robots import RobotError
from robocorba.robot.smartpal_stand_in.codes import Alarm
from robocorba.robot.smartpal_stand_in.unit import Unit

#: Maximum delay of a call [s].
MAX_DELAY_S = 5.0
#: Maximum number of calls that are delayed simultaneously; further calls fail immediately.
MAX_HELD_CALLS = 32


class InvalidFault(FieldError, RobotError):
    """`field` of a fault is invalid."""


class Faults:
    """units: by the names under which they are bound."""

    def __init__(self, units: Mapping[str, Unit]) -> None:
        self._units = units
        self._delay_s = 0.0
        self._lost: set[str] = set()
        self._held = 0
        self._changed = threading.Condition()
        self._is_closed = False

    # ---- switches ----

    def alarm(self, unit: str, alarm: Alarm) -> None:
        """Set a persistent alarm; code 0 removes it."""
        self._unit(unit).set_persistent_alarm(alarm if alarm.code else None)

    def stuck(self, unit: str, on: bool) -> None:
        self._unit(unit).jam(on)

    def lost(self, unit: str, on: bool) -> None:
        self._unit(unit)
        with self._changed:
            (self._lost.add if on else self._lost.discard)(unit)
            self._changed.notify_all()

    def slow_network(self, delay_s: float) -> None:
        if not (math.isfinite(delay_s) and 0.0 <= delay_s <= MAX_DELAY_S):
            raise InvalidFault("delay", f"{delay_s} s is outside 0 to {MAX_DELAY_S:g} s")
        self._delay_s = delay_s

    def emergency_switch(self, pressed: bool) -> None:
        for unit in self._units.values():
            unit.emergency_switch(pressed)

    def none(self) -> None:
        """Switch all faults off."""
        for name, unit in self._units.items():
            unit.set_persistent_alarm(None)
            unit.jam(False)
            self.lost(name, False)
        self.emergency_switch(False)
        self.slow_network(0.0)

    def close(self) -> None:
        """Fail all calls that are being delayed."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    # ---- called for each call to a unit ----

    def delivers(self, unit: str) -> bool:
        """Delay a call to a unit as the faults demand; whether the call reaches the unit."""
        if not self._delay_s and unit not in self._lost:
            return True
        with self._changed:
            if self._held >= MAX_HELD_CALLS:
                return False
            self._held += 1
            try:
                if unit in self._lost:
                    self._changed.wait_for(lambda: unit not in self._lost or self._is_closed, MAX_DELAY_S)
                elif self._delay_s:
                    self._changed.wait_for(lambda: self._is_closed, self._delay_s)
                return unit not in self._lost and not self._is_closed
            finally:
                self._held -= 1

    def _unit(self, name: str) -> Unit:
        if name not in self._units:
            raise InvalidFault("unit", f"unknown unit {name[:40]!r}; the units are {', '.join(self._units)}")
        return self._units[name]
