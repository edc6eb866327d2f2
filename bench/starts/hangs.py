"""SIGSTOP of each server while a client calls it: how long it is away, beside an earlier commit.

    python -m bench.starts.hangs [--seconds 60] [--only NAME] [--base COMMIT]

SIGCONT follows after `seconds`. `away` is the longest time without an answer. A version that does not notice a hang is
back after SIGCONT. The same server of both systems is stopped at the same time."""

from __future__ import annotations

import contextlib
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psutil

from bench.common.harness import progress, run
from bench.starts.outage import LIMIT_S, Client, client
from bench.starts.systems import BASE, OURS, SERVERS, System, load, systems
from robocorba.orb.naming import PROBE_TIMEOUT_S
from robocorba.system.supervision.hangs import HangLimit
from robocorba.system.supervision.system import NAMING_SERVICE
from testkit.processes import eventually, hang
from testkit.report import at_most, bars, summarize

#: Required time until a stopped server is back [s]: the limit, the timeout of the last call, and a start.
MAX_AWAY_S = HangLimit().limit_s + PROBE_TIMEOUT_S + 1.2


def stopped(system: System, calls: Client, server: str, seconds: float) -> dict[str, Any]:
    """A row: a server is stopped for a time, or until it is killed."""
    with calls.calling(server):
        process = psutil.Process(system.running.pid(server))
        began = time.monotonic()
        hang(process.pid)
        with contextlib.suppress(psutil.TimeoutExpired):
            process.wait(seconds)
        with contextlib.suppress(psutil.NoSuchProcess):
            process.resume()
        away_s = calls.away_s(began, time.monotonic())
    eventually(lambda: system.is_running(server), LIMIT_S, f"{server} that runs")
    was_killed = system.running.pid(server) != process.pid
    return {
        "server": server,
        "version": system.version.name,
        "away, s": away_s,
        "restarted": "yes" if was_killed else "no",
    }


def measure(seconds: float = 60.0, only: str = "", base: str = BASE) -> bool:
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        both = stack.enter_context(systems(base, folder))
        callers = [(system, stack.enter_context(client(system, folder))) for system in both]
        pool = stack.enter_context(ThreadPoolExecutor(len(callers)))
        for server in progress([one for one in (NAMING_SERVICE, *SERVERS) if only in one], "SIGSTOP"):
            rows += [done.result() for done in [pool.submit(stopped, *one, server, seconds) for one in callers]]
    marks = [at_most(f"{row['server']} away, s", row["away, s"], MAX_AWAY_S) for row in rows if row["version"] == OURS]
    picture = bars({f"{row['server']}, {row['version']}": row["away, s"] for row in rows}, "s without an answer")
    return summarize("starts_hangs", f"a server that is stopped for {seconds:g} s", rows, marks, picture, load=load())


if __name__ == "__main__":
    run(
        measure,
        seconds="between SIGSTOP and SIGCONT",
        only="only servers with this in their name",
        base="commit to compare with, empty for none",
    )
