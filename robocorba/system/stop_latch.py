"""The latch of a robot's stops, at both ends of an emergency stop."""

from __future__ import annotations

import threading
from collections.abc import Mapping

#: Reason of a stop that gives none.
EMERGENCY_STOP = "emergency stop"
#: Maximum number of different reasons that are kept; a further one counts as the last of them.
MAX_REASONS = 16


class StopLatch:
    """Counts stops. An end names the number of the last stop that it has seen, and ends that and all earlier ones: what
    happens at the same time can't take back a later stop. Thread-safe.

    number: of the last stop. ended: stops up to this one have ended. reasons: of the stops that hold, in the order in
    which they were first given, each with the number of the last stop that gave it."""

    def __init__(self, number: int = 0, reasons: Mapping[str, int] | None = None) -> None:
        self._lock = threading.Lock()
        self.number, self.ended = number, 0
        #: Replaced, never changed.
        self.reasons: Mapping[str, int] = dict(reasons or {})

    @property
    def is_on(self) -> bool:
        return bool(self.reasons)

    @property
    def reason(self) -> str:
        """The first reason that holds; empty if none does."""
        return self.reason_after(0)

    def reason_after(self, number: int) -> str:
        """The first reason that holds by a stop after this number; empty if none does."""
        return next((reason for reason, last in self.reasons.items() if last > number), "")

    def stop(self, reason: str) -> int:
        """Hold; returns the number of this stop."""
        reason = reason or EMERGENCY_STOP
        with self._lock:
            if len(self.reasons) >= MAX_REASONS and reason not in self.reasons:
                reason = [*self.reasons][-1]
            number = self.number + 1
            self.reasons = {**self.reasons, reason: number}
            self.number = number
            return number

    def end(self, number: int) -> None:
        """End the stops up to `number`. A number that no stop has had ends nothing."""
        with self._lock:
            if number <= self.number:
                self.ended = max(self.ended, number)
                self.reasons = {reason: last for reason, last in self.reasons.items() if last > number}
