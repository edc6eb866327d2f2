"""Idle channels in a full mesh: the processor time of their links, and how soon all others notice that one hangs."""

from __future__ import annotations

import itertools
import statistics
import string
import time
from collections.abc import Sequence
from typing import Any

import psutil

from bench.common.harness import folder_of_bench
from robocorba.stubs import RoboCorba
from testkit.federation import Channels, channels
from testkit.json_process import Cpu
from testkit.processes import eventually
from testkit.report import PROGRESS, at_most, curves, summarize

CHANNELS = (2, 5, 10, 20, 30)
#: Maximum CPU of all channels together with the most channels [% of a core].
MAX_CPU_PERCENT = 30.0
#: Maximum time until all others show their links with a channel that hangs as down [s], as docs/operations.md says.
MAX_NOTICE_S = 3.5
LINK_LIMIT_S = 300.0
SETTLE_S = 5.0


def mesh(quick: bool) -> bool:
    """Whether every mark was reached."""
    rows = [_mesh(count, *((1, 5.0) if quick else (3, 30.0))) for count in CHANNELS]
    marks = [
        at_most(f"CPU of {CHANNELS[-1]} idle channels, % of a core", rows[-1]["CPU, % of a core"], MAX_CPU_PERCENT),
        at_most("a channel that hangs is noticed by all, s", max(row["noticed, s"] for row in rows), MAX_NOTICE_S),
    ]
    cpu = {"all channels": [row["CPU, % of a core"] for row in rows]}
    draw = curves(CHANNELS, cpu, "channels in a full mesh", ylabel="CPU, % of a core", ylim=(0, None))
    return summarize("event_channel_mesh", "Idle channels, each linked with all others", rows, marks, draw)


def _mesh(count: int, rounds: int, seconds: float) -> dict[str, Any]:
    """The row of `count` channels: CPU in `seconds`, and the median of `rounds` times until all notice."""
    names = string.ascii_letters[:count]
    pairs = [a + b for a, b in itertools.combinations(names, 2)]
    with folder_of_bench() as folder, channels(folder) as federation:
        linked_s = link(federation, names, pairs)
        time.sleep(SETTLE_S)
        pids = [process.pid for process in federation.processes.values()]
        cpu, began = Cpu(pids), time.monotonic()
        time.sleep(seconds)
        percent = sum(cpu.spent_s()) / (time.monotonic() - began) * 100
        memory = statistics.median(psutil.Process(pid).memory_info().rss / 2**20 for pid in pids)
        noticed = [_noticed_s(federation, names, pairs) for _ in range(rounds)]
    PROGRESS.print(f"mesh: {count} channels: {percent:.1f} % of a core, {statistics.median(noticed):.2f} s")
    return {
        "channels": count,
        "links": len(pairs),
        "to link all, s": linked_s,
        "CPU, % of a core": percent,
        "memory of one, MiB": memory,
        "noticed, s": statistics.median(noticed),
        "slowest": max(noticed),
    }


def link(federation: Channels, names: Sequence[str], pairs: Sequence[Any]) -> float:
    """Start channels and link these pairs; the time from the first to the last link [s]."""
    for name in names:
        federation.spawn(name)
    for name in names:
        federation.wait_ready(name)
    began = time.monotonic()
    for a, b in pairs:
        federation.channel(a).addPeer(RoboCorba.PeerAddress(b, "", False))
    eventually(lambda: federation.is_up(*pairs), LINK_LIMIT_S, "links")
    return time.monotonic() - began


def _noticed_s(federation: Channels, names: str, pairs: list[str]) -> float:
    """Time from SIGSTOP of the last channel until all others show both directions of its link as down [s]."""
    victim, others = names[-1], set(names[:-1])
    with federation.stopped(victim):
        began = time.monotonic()
        while others:
            for name in list(others):
                states = [federation.outgoing(name, victim), federation.incoming(name, victim)]
                if all(state.condition == RoboCorba.DOWN for state in states):
                    others.remove(name)
            assert time.monotonic() < began + LINK_LIMIT_S, f"{victim} hangs, unnoticed by {sorted(others)}"
        noticed_s = time.monotonic() - began
    eventually(lambda: federation.is_up(*pairs), LINK_LIMIT_S, "links")
    return noticed_s
