"""kill -9 of each server while a client calls it: how long it is away, beside that of an earlier commit.

    python -m bench.starts.kills [--rounds 20] [--only NAME] [--base COMMIT]

A process calls one object 200 times a second with a timeout of 1 s, by a reference that it keeps. `away` is the time
from its last answer before the kill to its first answer after it. Both systems run at the same time; in each round
every server of each of them is killed once."""

from __future__ import annotations

import contextlib
import random
import tempfile
import time
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from bench.common.harness import progress, run
from bench.starts.outage import client, killed
from bench.starts.systems import BASE, OURS, SERVERS, load, median, systems
from robocorba.system.supervision.system import NAMING_SERVICE
from testkit.report import at_most, summarize

#: Required median and worst of all servers [s].
MAX_MEDIAN_S, MAX_WORST_S = 0.6, 1.2
#: Longest pause between kills [s], of random length, so that they do not follow the beat of the supervisor's checks.
MAX_PAUSE_S = 0.3


def measure(rounds: int = 20, only: str = "", base: str = BASE) -> bool:
    found: dict[tuple[str, str], list[float]] = {}
    loads = []
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        both = stack.enter_context(systems(base, folder))
        callers = [(system, stack.enter_context(client(system, folder))) for system in both]
        chosen = [server for server in (NAMING_SERVICE, *SERVERS) if only in server]
        kills = [(server, *caller) for _ in range(rounds) for server in chosen for caller in callers]
        for server, system, calls in progress(kills, "kill -9"):
            time.sleep(random.uniform(0.0, MAX_PAUSE_S))
            loads.append(load())
            found.setdefault((system.version.name, server), []).append(killed(system, calls, server))
    rows = [row(*key, values) for key, values in found.items()]
    ours = {server: values for (version, server), values in found.items() if version == OURS}
    marks = [
        mark
        for server, values in ours.items()
        if server != NAMING_SERVICE  # is a program of its own, and starts alone
        for mark in (
            at_most(f"{server} away, median, s", median(values), MAX_MEDIAN_S),
            at_most(f"{server} away, worst, s", max(values), MAX_WORST_S),
        )
    ]

    def draw(axes: Axes) -> None:
        for number, ((version, _), values) in enumerate(found.items()):
            axes.plot(values, [number] * len(values), "|b" if version == OURS else "|r", markersize=12)
        axes.set(xscale="log", xlabel="s without an answer")
        axes.set_yticks(range(len(found)), [f"{server}, {version}" for version, server in found], fontsize=7)
        axes.invert_yaxis()

    return summarize("starts_kills", "a server that is killed", rows, marks, draw, load=median(loads), s=_plain(found))


def row(version: str, server: str, values: list[float]) -> dict[str, Any]:
    ordered = sorted(values)
    return {
        "server": server,
        "version": version,
        "kills": len(values),
        "away, median, s": median(values),
        "shortest": ordered[0],
        "longest": ordered[-1],
    }


def _plain(found: dict[tuple[str, str], list[float]]) -> dict[str, list[float]]:
    return {" ".join(key): values for key, values in found.items()}


if __name__ == "__main__":
    run(
        measure,
        rounds="kills of each server",
        only="only servers with this in their name",
        base="commit to compare with, empty for none",
    )
