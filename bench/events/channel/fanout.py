"""The cost of a delivery with 1 to 200 consumers of one channel."""

from __future__ import annotations

import statistics
from collections import defaultdict
from typing import Any

from bench.common.processes import Cpu, Process
from bench.events.channel.peers.corba import HEADER, PLAIN
from bench.events.channel.stage import Stage, collect, ready, send
from robocorba.testing.report import PROGRESS, at_most, curves, summarize

CONSUMERS = (1, 10, 50, 100, 200)
PROCESSES = 4
WAYS = (PLAIN.name, HEADER.name)
#: Maximum ratio of the cost of a delivery with many consumers to that with one.
MAX_GROWTH = 1.5
MAX_EVENTS = 5000
_LIMIT_S = 120.0


def measure(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, deliveries = (2, 10_000) if quick else (5, 30_000)
    found: dict[tuple[str, int], list[tuple[float, float, int]]] = defaultdict(list)
    for number in range(rounds):
        for count in CONSUMERS:
            for peer in WAYS:
                found[peer, count].append(_round(peer, count, deliveries))
                cost = found[peer, count][-1][0]
                PROGRESS.print(f"fanout: round {number + 1} of {rounds}: {peer}, {count} consumers: {cost:.1f} us")
    rows: list[dict[str, Any]] = [
        {
            "consumers are": peer,
            "consumers": count,
            "CPU, us": statistics.median(cpu for cpu, _, _ in results),
            "wall, us": statistics.median(wall for _, wall, _ in results),
            "lost": sum(lost for _, _, lost in results),
        }
        for (peer, count), results in found.items()
    ]
    costs = {
        f"{peer}, {column}": [row[column] for row in rows if row["consumers are"] == peer]
        for peer in WAYS
        for column in ("CPU, us", "wall, us")
    }
    marks = [
        at_most("events lost", sum(row["lost"] for row in rows), 0),
        *(
            at_most(f"{what} a delivery, worst / one consumer", max(us) / us[0], MAX_GROWTH)
            for what, us in costs.items()
        ),
    ]
    title = "Cost of a delivery: CPU time of the channel's process, and wall time"
    draw = curves(CONSUMERS, costs, "consumers", xscale="log", ylabel="us for each delivery", ylim=(0, None))
    return summarize("event_channel_fanout", title, rows, marks, draw)


def _round(peer: str, count: int, deliveries: int) -> tuple[float, float, int]:
    """CPU and wall time of a delivery to `count` consumers [us], and lost events."""
    with Stage() as stage:
        broker = stage.broker(peer)
        shares = [count // PROCESSES + (place < count % PROCESSES) for place in range(min(PROCESSES, count))]
        consumers = [stage.consumer(peer, broker, share) for share in shares]
        ready(*consumers)
        supplier = stage.supplier(peer, broker)
        ready(supplier)
        events = min(MAX_EVENTS, deliveries // count)
        _flood(supplier, consumers, 0, max(20, events // 10))
        cpu = Cpu([broker.pid])
        ns, lost = _flood(supplier, consumers, 1_000_000, events)
        return cpu.spent_s()[0] / (events * count) * 1e6, ns / (events * count) / 1e3, lost


def _flood(supplier: Process, consumers: list[Process], first: int, events: int) -> tuple[int, int]:
    """Time until the last arrival [ns], and lost events."""
    answer = send(supplier, "flood", 2 * _LIMIT_S, first=first, seconds=_LIMIT_S, most=events)
    sent = range(first, first + events)
    got = [one for consumer in consumers for one in collect(consumer, [sent], _LIMIT_S)]
    return max(one["last"] for one in got) - answer["began"], sum(one["lost"] for one in got)
