"""Additional load on the leader's computer: a process that keeps a core busy for a given share of the time.

python -m bench.events.network.load CORE: reads lines of JSON on stdin with the total load of the core (0 to 0.95),
answers each with null, and ends with its stdin. It adds to the load of the other processes on the core, so a total
below their load cannot be reached.
"""

from __future__ import annotations

import random
import sys
import threading
import time

import psutil

from testkit.json_process import answer_lines

#: Mean period of work and sleep [s].
PERIOD_S = 0.01
#: Interval of the load control [s], and its gain.
LOOK_S, GAIN = 0.2, 0.3
MAX_SHARE = 0.95


class Core:
    """The load of a core since the last query."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._idle_s, self._at = self._read()

    def busy(self) -> float:
        """The share of the time in which the core was not idle. Idle time is exact; the kernel estimates the kinds of
        work from samples."""
        idle_s, at = self._read()
        share = 1 - (idle_s - self._idle_s) / (at - self._at)
        self._idle_s, self._at = idle_s, at
        return min(1.0, max(0.0, share))

    def _read(self) -> tuple[float, float]:
        times = psutil.cpu_times(percpu=True)[self._number]
        return times.idle + getattr(times, "iowait", 0.0), time.monotonic()


class Governor:
    """Controls the share of work so that the core has the wanted load."""

    def __init__(self) -> None:
        self.wanted = self.work = 0.0

    def want(self, share: float) -> None:
        """Change the wanted share."""
        self.work = max(0.0, self.work + share - self.wanted) if share else 0.0
        self.wanted = share

    def correct(self, busy: float) -> None:
        """Adjust the work to the measured load of the core."""
        self.work = min(MAX_SHARE, max(0.0, self.work + GAIN * (self.wanted - busy))) if self.wanted else 0.0


def work(governor: Governor, core: Core) -> None:
    """Work and sleep for random durations: constant ones could synchronise with the kernel clock or the robots."""
    look_at = time.monotonic() + LOOK_S
    while True:
        began = time.monotonic()
        period = PERIOD_S * random.uniform(0.5, 1.5)
        end = began + governor.work * period
        while time.monotonic() < end:
            pass
        if time.monotonic() > look_at:
            governor.correct(core.busy())
            look_at = time.monotonic() + LOOK_S
        time.sleep(max(0.0, began + period - time.monotonic()))


if __name__ == "__main__":
    governor = Governor()
    threading.Thread(target=work, args=(governor, Core(int(sys.argv[1]))), daemon=True).start()
    answer_lines(governor.want)
