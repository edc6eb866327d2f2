"""The timers of Windows XP: sleeps and timeouts end on a grid of 15.6 ms.

python -m bench.events.network.timers MODULE ...: runs a module with them. Only Python's own waits are changed; a wait
that ends because of an event ends at once, as it does there."""

from __future__ import annotations

import math
import random
import runpy
import sys
import threading
import time

#: The period of the clock interrupt [s].
TICK_S = 1 / 64


def use_grid() -> None:
    """Round up all later sleeps and timeouts of this process. Its grid has a phase of its own, as each computer's."""
    phase_s = random.uniform(0.0, TICK_S)
    sleep, wait = time.sleep, threading.Condition.wait

    def to_tick(duration_s: float) -> float:
        now = time.monotonic() + phase_s
        return math.ceil((now + duration_s) / TICK_S) * TICK_S - now if duration_s > 0.0 else duration_s

    def wait_to_tick(condition: threading.Condition, timeout: float | None = None) -> bool:
        return wait(condition, None if timeout is None else to_tick(timeout))

    setattr(time, "sleep", lambda duration_s: sleep(to_tick(duration_s)))  # noqa: B010
    setattr(threading.Condition, "wait", wait_to_tick)  # noqa: B010


if __name__ == "__main__":
    use_grid()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
