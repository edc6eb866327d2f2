"""Faults of the stand-in, switched on and off while it runs; no robot offers this."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping

from robocorba.errors.base import FieldError
from robocorba.errors.robots import RobotError
from robocorba.smartpal.codes import Alarm
from robocorba.smartpal.unit import Unit

#: A call is held back so long at most, s, and so many calls at once; others are cut off right away.
MOST_DELAY_S, MOST_HELD = 5.0, 32


class InvalidFault(FieldError, RobotError):
    """`field` of a fault can't be."""


class Faults:
    """units: by the names that they are bound as."""

    def __init__(self, units: Mapping[str, Unit]) -> None:
        self._units = units
        self._delay_s = 0.0
        self._lost: set[str] = set()
        self._held = 0
        self._changed = threading.Condition()
        self._is_closed = False

    # ---- switches ----

    def alarm(self, unit: str, alarm: Alarm) -> None:
        """Code 0 switches off."""
        self._unit(unit).lasting_alarm(alarm if alarm.code else None)

    def stuck(self, unit: str, on: bool) -> None:
        self._unit(unit).jam(on)

    def lost(self, unit: str, on: bool) -> None:
        self._unit(unit)
        with self._changed:
            (self._lost.add if on else self._lost.discard)(unit)
            self._changed.notify_all()

    def slow_network(self, delay_s: float) -> None:
        if not (math.isfinite(delay_s) and 0.0 <= delay_s <= MOST_DELAY_S):
            raise InvalidFault("delay", f"{delay_s} is not 0 to {MOST_DELAY_S:g} s")
        self._delay_s = delay_s

    def emergency_switch(self, pressed: bool) -> None:
        for unit in self._units.values():
            unit.emergency_switch(pressed)

    def none(self) -> None:
        """All is well again."""
        for name, unit in self._units.items():
            unit.lasting_alarm(None)
            unit.jam(False)
            self.lost(name, False)
        self.emergency_switch(False)
        self.slow_network(0.0)

    def close(self) -> None:
        """Let go of all calls that are held back."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    # ---- on the way of a call ----

    def reaches(self, unit: str) -> bool:
        """Hold a call to a unit back as long as the network does; whether it gets there."""
        if not self._delay_s and unit not in self._lost:
            return True
        with self._changed:
            if self._held >= MOST_HELD:
                return False
            self._held += 1
            try:
                if unit in self._lost:
                    self._changed.wait_for(lambda: unit not in self._lost or self._is_closed, MOST_DELAY_S)
                elif self._delay_s:
                    self._changed.wait_for(lambda: self._is_closed, self._delay_s)
                return unit not in self._lost and not self._is_closed
            finally:
                self._held -= 1

    def _unit(self, name: str) -> Unit:
        if name not in self._units:
            raise InvalidFault("unit", f"there is no {name[:40]!r}; there are {', '.join(self._units)}")
        return self._units[name]
