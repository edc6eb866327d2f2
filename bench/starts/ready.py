"""`robocorba up` until `ready`.

    python -m bench.starts.ready [--rounds 5]
    python -m bench.starts.ready --empty --rounds 1

Compiled kernels are in the cache; with --empty each start has an empty one, as on a new machine."""

from __future__ import annotations

import functools
import time
from pathlib import Path
from statistics import median

from bench.common.harness import folder_of_bench, progress, run
from robocorba.system.claimed_ports import claimed_ports
from testkit.processes import Launcher, drain, real_system
from testkit.report import at_most, summarize

#: Required median time of a start with compiled kernels [s].
MAX_S = 2.5


def start_s(folder: Path, **environment: str) -> float:
    """The time of one start [s]."""
    began = time.monotonic()
    with claimed_ports() as port, Launcher(folder) as launch:
        running = real_system(functools.partial(launch, **environment), folder / "state", port).wait_ready()
        ready_s = time.monotonic() - began
        drain(running.process)
        running.stop()
    return ready_s


def main(rounds: int = 5, empty: bool = False) -> bool:
    seconds: dict[str, float] = {}
    with folder_of_bench() as folder:
        if not empty:
            start_s(folder)  # a new state; kernels may not be compiled yet
        for number in progress(range(1, 1 + rounds), "starts of `robocorba up`"):
            place = folder / str(number) if empty else folder
            place.mkdir(exist_ok=True)
            environment = {"XDG_CACHE_HOME": str(place / "cache")} if empty else {}
            seconds[str(number)] = start_s(place, **environment)
    rows = [{"start": number, "ready after, s": took_s} for number, took_s in seconds.items()]
    marks = [] if empty else [at_most("ready after, median, s", median(seconds.values()), MAX_S)]
    return summarize("starts_ready", f"`robocorba up` {'without' if empty else 'with'} compiled kernels", rows, marks)


if __name__ == "__main__":
    run(main, rounds="number of starts", empty="without compiled kernels")
