"""`robocorba up` until `ready`: time, and CPU time of all its processes.

    python -m bench.starts.ready [--rounds 7]
    python -m bench.starts.ready --empty [--rounds 1]

Compiled kernels are in the cache; with --empty each start has an empty one, as on a new machine."""

from __future__ import annotations

import contextlib
import functools
import os
import time
from pathlib import Path
from statistics import median
from typing import Any

import psutil

from bench.common.harness import folder_of_bench, progress, run
from robocorba.system.claimed_ports import claimed_ports
from testkit.processes import Launcher, drain, real_system
from testkit.report import at_most, bars, summarize

#: Required median time of a start with compiled kernels [s].
MAX_S = 2.5
#: Time after `ready` whose CPU time is measured as well [s]: work that was put off counts too.
AFTER_S = 5.0


def start(folder: Path, **environment: str) -> dict[str, Any]:
    """A row: one start."""
    load, began = os.getloadavg()[0], time.monotonic()
    with claimed_ports() as port, Launcher(folder) as launch:
        running = real_system(functools.partial(launch, **environment), folder / "state", port).wait_ready()
        ready_s, cpu_s = time.monotonic() - began, cpu_of_all_s(running.process.pid)
        drain(running.process)
        time.sleep(AFTER_S)
        after_s = cpu_of_all_s(running.process.pid) - cpu_s
        running.stop()
    return {
        "ready after, s": ready_s,
        "CPU until then, s": cpu_s,
        f"CPU of the next {AFTER_S:g} s": after_s,
        "load": load,
    }


def cpu_of_all_s(pid: int) -> float:
    """CPU time of a process and all below it, those that have ended included [s]."""
    up, spent_s = psutil.Process(pid), 0.0
    for process in (up, *up.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            spent_s += sum(process.cpu_times()[:4])
    return spent_s


def main(rounds: int = 0, empty: bool = False) -> bool:
    rows = []
    with folder_of_bench() as folder:
        if not empty:
            start(folder)  # a new state; kernels may not be compiled yet
        for number in progress(range(1, 1 + (rounds or (1 if empty else 7))), "starts of `robocorba up`"):
            place = folder / str(number) if empty else folder
            place.mkdir(exist_ok=True)
            environment = {"XDG_CACHE_HOME": str(place / "cache")} if empty else {}
            rows.append({"start": str(number), **start(place, **environment)})
    seconds = {row["start"]: row["ready after, s"] for row in rows}
    marks = [] if empty else [at_most("ready after, median, s", median(seconds.values()), MAX_S)]
    name, title = ("starts_empty", "without kernels") if empty else ("starts_ready", "with compiled kernels")
    return summarize(name, f"`robocorba up` {title}", rows, marks, bars(seconds, "s until ready"))


if __name__ == "__main__":
    run(main, rounds="number of starts, 0: 7, or 1 if empty", empty="without compiled kernels")
