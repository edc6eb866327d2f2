"""Load on the leader's computer: turns of work and pauses that keep a core busy for a given share of the time.

python -m bench.events.network.load CORE: a process that competes with the leader. {"do": "want", "share": 0.6} on
stdin changes the total load of the core. It adds to the load of the other processes on the core, so a total below their
load cannot be reached.
"""

from __future__ import annotations

import hashlib
import random
import sys
import threading
import time
from collections.abc import Callable

import psutil

from testkit.json_process import answer_commands

#: Work of a turn of the competitor [s].
WORK_S = 0.005
#: Interval of the load control [s], and its gain.
LOOK_S, GAIN = 0.2, 0.3
MAX_SHARE = 0.95
#: What is hashed as work: large enough that Python releases its lock, as it does when it draws.
BLOCK = bytes(16384)


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


def start_turns(governor: Governor, core: Core, work_s: float, act: Callable[[], None] = lambda: None) -> None:
    """Work for about `work_s`, act, and pause so long that the core has the governor's load; in a thread, without end.

    Durations are random: constant ones could synchronise with the kernel clock or the robots. Without load to add, a
    turn has no work, and the longest pause."""
    threading.Thread(target=_turns, args=(governor, core, work_s, act), daemon=True).start()


def _turns(governor: Governor, core: Core, work_s: float, act: Callable[[], None]) -> None:
    look_at = time.monotonic() + LOOK_S
    while True:
        began = time.monotonic()
        work = work_s * random.uniform(0.5, 1.5) if governor.work else 0.0
        while time.monotonic() < began + work:
            hashlib.sha256(BLOCK)
        act()
        if time.monotonic() > look_at:
            governor.correct(core.busy())
            look_at = time.monotonic() + LOOK_S
        turn = min(LOOK_S, work / governor.work) if governor.work else LOOK_S
        time.sleep(max(0.0, began + turn - time.monotonic()))


if __name__ == "__main__":
    governor = Governor()
    start_turns(governor, Core(int(sys.argv[1])), WORK_S)
    answer_commands(governor.want)
