"""The cost of a delivery of one channel to 1 to 2,000 consumers."""

from __future__ import annotations

import statistics
from collections import defaultdict
from typing import Any, NamedTuple

from bench.events.channel.stage import Stage, collect, ready, send
from testkit.json_process import Cpu, Process
from testkit.peers.corba import HEADER, PLAIN
from testkit.report import PROGRESS, at_least, at_most, curves, summarize

CONSUMERS = (1, 10, 100, 300, 1000, 2000)
PROCESSES = 4
WAYS = (PLAIN.name, HEADER.name)
#: Maximum ratio of the cost of a delivery with many consumers to that with one.
MAX_COST_GROWTH = 1.5
#: Minimum ratio of the deliveries a second with more than MANY consumers to those with MANY.
MANY, MIN_RATE_KEPT = 100, 0.7
#: Events of a flood: the longer it lasts, the more of them go in one call, so those with MANY or more have as many.
MIN_EVENTS, MAX_EVENTS, DELIVERIES = 100, 5000, 10_000
FANOUT_LIMIT_S = 120.0


def fanout(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds = 2 if quick else 5
    found: dict[tuple[str, int], list[Fanout]] = defaultdict(list)
    for number in range(rounds):
        for count in CONSUMERS:
            for peer in WAYS:
                found[peer, count].append(_fanout_round(peer, count))
                cost = found[peer, count][-1].cpu_us
                PROGRESS.print(f"fanout: round {number + 1} of {rounds}: {peer}, {count} consumers: {cost:.1f} us")
    rows: list[dict[str, Any]] = [
        {
            "consumers are": peer,
            "consumers": count,
            "to subscribe, s": statistics.median(one.subscribed_s for one in results),
            "CPU, us": statistics.median(one.cpu_us for one in results),
            "wall, us": (wall := statistics.median(one.wall_us for one in results)),
            "deliveries/s": 1e6 / wall,
            "lost": sum(one.lost for one in results),
        }
        for (peer, count), results in found.items()
    ]
    costs = {
        f"{peer}, {column}": [row[column] for row in rows if row["consumers are"] == peer]
        for peer in WAYS
        for column in ("CPU, us", "wall, us")
    }
    rates = {(row["consumers are"], row["consumers"]): row["deliveries/s"] for row in rows}
    marks = [
        at_most("events lost", sum(row["lost"] for row in rows), 0),
        *(
            at_least(
                f"{peer}: deliveries/s, worst of more than {MANY} consumers / {MANY}",
                min(rates[peer, count] for count in CONSUMERS if count > MANY) / rates[peer, MANY],
                MIN_RATE_KEPT,
            )
            for peer in WAYS
        ),
        *(
            at_most(f"{what} a delivery, worst / one consumer", max(us) / us[0], MAX_COST_GROWTH)
            for what, us in costs.items()
        ),
    ]
    title = "Deliveries of one channel, and CPU time of its process"
    shown = {
        f"{peer}, {column}": [row[column] for row in rows if row["consumers are"] == peer]
        for peer in WAYS
        for column in ("deliveries/s", "to subscribe, s")
    }
    draw = curves(CONSUMERS, shown, "consumers", xscale="log", yscale="log", ylabel="deliveries/s; s to subscribe all")
    return summarize("event_channel_fanout", title, rows, marks, draw)


class Fanout(NamedTuple):
    """Time in which all consumers subscribed [s], CPU and wall time of a delivery [us], and lost events."""

    subscribed_s: float
    cpu_us: float
    wall_us: float
    lost: int


def _fanout_round(peer: str, count: int) -> Fanout:
    """With `count` consumers."""
    with Stage() as stage:
        broker = stage.broker(peer)
        shares = [count // PROCESSES + (place < count % PROCESSES) for place in range(min(PROCESSES, count))]
        consumers = [stage.consumer(peer, broker, share) for share in shares]
        subscribed_s = ready(*consumers)
        supplier = stage.supplier(peer, broker)
        ready(supplier)
        events = max(MIN_EVENTS, min(MAX_EVENTS, DELIVERIES // count))
        _flood(supplier, consumers, 0, max(20, events // 10))
        cpu = Cpu([broker.pid])
        ns, lost = _flood(supplier, consumers, 1_000_000, events)
        each = 1e6 / (events * count)
        return Fanout(subscribed_s, cpu.spent_s()[0] * each, ns / 1e9 * each, lost)


def _flood(supplier: Process, consumers: list[Process], first: int, events: int) -> tuple[int, int]:
    """Time until the last arrival [ns], and lost events."""
    answer = send(supplier, "flood", 2 * FANOUT_LIMIT_S, first=first, seconds=FANOUT_LIMIT_S, most=events)
    sent = range(first, first + events)
    got = [one for consumer in consumers for one in collect(consumer, [sent], FANOUT_LIMIT_S)]
    return max(one["last"] for one in got) - answer["began"], sum(one["lost"] for one in got)
