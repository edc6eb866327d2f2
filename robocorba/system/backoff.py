"""Pauses between the attempts of an operation that failed."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Backoff:
    """Pauses between attempts [s]: `first_s`, then each `factor` times the one before, at most `max_s`.

    jitter: largest share by which a pause is shortened at random, so that processes that failed at the same time do not
    retry at the same time."""

    first_s: float
    max_s: float
    factor: float = 2.0
    jitter: float = 0.0

    def pause_s(self, failures: int) -> float:
        """Pause after this number of failures in a row [s]; 0 after none."""
        if not failures:
            return 0.0
        pause_s = min(self.first_s * self.factor ** min(failures - 1, 60), self.max_s)
        return pause_s * (1.0 - self.jitter * random.random()) if self.jitter else pause_s

    def call(self, operation: Callable[[], T], timeout_s: float, *errors: type[Exception]) -> T:
        """The answer of `operation`, repeated while it raises one of `errors`.

        Raises the last of them when the next attempt would begin later than `timeout_s`."""
        deadline, failures = time.monotonic() + timeout_s, 0
        while True:
            try:
                return operation()
            except errors:
                failures += 1
                pause_s = self.pause_s(failures)
                if time.monotonic() + pause_s > deadline:
                    raise
            time.sleep(pause_s)

    def poll(self, condition: Callable[[], T], timeout_s: float) -> T:
        """The first true answer of `condition`, else its last answer within `timeout_s`."""
        deadline, failures = time.monotonic() + timeout_s, 0
        while not (answer := condition()) and time.monotonic() <= deadline:
            failures += 1
            time.sleep(self.pause_s(failures))
        return answer
