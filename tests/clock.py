"""A clock for tests of what takes time."""

from __future__ import annotations


class Clock:
    """Time that a test sets [s]."""

    def __init__(self, now: float = 100.0) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now
