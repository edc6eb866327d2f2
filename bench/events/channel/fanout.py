"""The cost of a delivery with 1 to 200 consumers of one channel."""

from __future__ import annotations

import statistics
from collections import defaultdict
from typing import Any

import psutil
from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.processes import Process
from bench.events.channel.peers.ours import HEADER, PLAIN
from bench.events.channel.stage import Stage, collect, ready
from robocorba.testing.report import PROGRESS, at_most, summarize

CONSUMERS = (1, 10, 50, 100, 200)
PROCESSES = 4
WAYS = (PLAIN.name, HEADER.name)
#: Maximum ratio of the cost of a delivery with many consumers to that with one.
MAX_GROWTH = 1.5
MAX_EVENTS = 5000
_LIMIT_S = 120.0


def run(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, deliveries = (2, 10_000) if quick else (5, 30_000)
    found: dict[tuple[str, int], list[dict[str, float]]] = defaultdict(list)
    for number in range(rounds):
        for count in CONSUMERS:
            for peer in WAYS:
                found[peer, count].append(_measure(peer, count, deliveries))
                cost = found[peer, count][-1]
                PROGRESS.print(
                    f"fanout: round {number + 1} of {rounds}: {peer}, {count} consumers: {cost['cpu']:.1f} us"
                )
    rows = [_row(peer, count, results) for (peer, count), results in found.items()]
    marks = [at_most("events lost", sum(row["lost"] for row in rows), 0)]
    for peer in WAYS:
        for column in ("CPU, us", "wall, us"):
            costs = [row[column] for row in rows if row["consumers are"] == peer]
            marks.append(
                at_most(f"{peer}, {column} a delivery, worst / one consumer", max(costs) / costs[0], MAX_GROWTH)
            )
    title = "Cost of a delivery: CPU time of the channel's process, and wall time"
    return summarize(RESULTS / "event_channel_fanout", title, rows, marks, lambda axes: _draw(axes, rows))


def _measure(peer: str, count: int, deliveries: int) -> dict[str, float]:
    """CPU and wall time of a delivery to `count` consumers [us]."""
    with Stage() as stage:
        broker = stage.broker(peer)
        shares = [count // PROCESSES + (place < count % PROCESSES) for place in range(min(PROCESSES, count))]
        consumers = [stage.consumer(peer, broker, share) for share in shares]
        ready(*consumers)
        supplier = stage.supplier(peer, broker)
        ready(supplier)
        channel = psutil.Process(broker.pid)
        events = min(MAX_EVENTS, deliveries // count)
        _flood(supplier, consumers, 0, max(20, events // 10))
        before = _cpu_s(channel)
        found = _flood(supplier, consumers, 1_000_000, events)
        made = events * count
        return {"cpu": (_cpu_s(channel) - before) / made * 1e6, "wall": found["ns"] / made / 1e3, "lost": found["lost"]}


def _flood(supplier: Process, consumers: list[Process], first: int, events: int) -> dict[str, int]:
    supplier.send({"do": "flood", "first": first, "seconds": _LIMIT_S, "most": events})
    answer = supplier.receive(2 * _LIMIT_S)
    sent = range(first, first + events)
    got = [one for consumer in consumers for one in collect(consumer, [sent], _LIMIT_S)]
    return {"ns": max(one["last"] for one in got) - answer["began"], "lost": sum(one["lost"] for one in got)}


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _row(peer: str, count: int, results: list[dict[str, float]]) -> dict[str, Any]:
    return {
        "consumers are": peer,
        "consumers": count,
        "CPU, us": statistics.median(one["cpu"] for one in results),
        "wall, us": statistics.median(one["wall"] for one in results),
        "lost": int(sum(one["lost"] for one in results)),
    }


def _draw(axes: Axes, rows: list[dict[str, Any]]) -> None:
    for peer in WAYS:
        mine = [row for row in rows if row["consumers are"] == peer]
        for column, style in (("CPU, us", "o-"), ("wall, us", "s--")):
            axes.plot(
                [row["consumers"] for row in mine], [row[column] for row in mine], style, label=f"{peer}, {column}"
            )
    axes.set(xscale="log", xlabel="consumers", ylabel="us for each delivery", ylim=(0, None))
    axes.legend()
