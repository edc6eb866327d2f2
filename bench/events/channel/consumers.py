"""Many consumers of one channel: a stopped one of ten, the cost of 1 to 2,000, and memory over an hour."""

from __future__ import annotations

import contextlib
import os
import signal
import statistics
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import psutil

from bench.events.channel.stage import Stage, collect, ready, send
from robocorba.system.repeating import Repeating
from testkit.json_process import Cpu, Process
from testkit.peers.corba import BOUND, BOUNDED, CLIENT, HEADER, PLAIN, connected
from testkit.processes import eventually
from testkit.report import PROGRESS, at_least, at_most, curves, quantile, summarize

# ---- one of ten consumers is stopped (SIGSTOP) ----


HEALTHY = 9
RATE = 200.0
#: Events before the stop, of which the first do not count, and during it: more than fit into the queue of a consumer.
BEFORE, WARM_UP, DURING = 1000, 100, 3 * BOUND
#: Maximum growth of the p99 latency of the healthy consumers.
MAX_LATENCY_GROWTH = 1.5
LIMIT_S = 60.0


def stalled(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds = []
    with Stage() as stage:
        broker = stage.broker(BOUNDED.name)
        consumers = [stage.consumer(BOUNDED.name, broker) for _ in range(HEALTHY + 1)]
        ready(*consumers)
        supplier = stage.supplier(BOUNDED.name, broker)
        ready(supplier)
        with connected(broker.address) as (_, channel):
            for number in range(2 if quick else 5):
                rounds.append(_stalled_round(channel, supplier, consumers, number))
                PROGRESS.print(f"stalled: round {number + 1}: p99 x {rounds[-1]['growth']:.2f}")
    growth = statistics.median(r["growth"] for r in rounds)
    marks = [
        at_most("growth of the p99 of the healthy, median of rounds", growth, MAX_LATENCY_GROWTH),
        at_most("events that the healthy lost", sum(r["lost by healthy"] for r in rounds), 0),
        at_most("events beside the account of the stalled one", sum(r["unaccounted"] for r in rounds), 0),
        at_most("events that it lost though younger than others it got", sum(r["not the oldest"] for r in rounds), 0),
    ]
    title = f"One of {HEALTHY + 1} consumers stopped at {RATE:g} events a second, latency of the others in us"
    p99 = {column: [one[column] for one in rounds] for column in ("p99 before", "p99 during")}
    draw = curves([one["round"] for one in rounds], p99, "round", ylabel="us", ylim=(0, None))
    return summarize("event_channel_stalled", title, rounds, marks, draw)


def _stalled_round(channel: Any, supplier: Process, consumers: list[Process], number: int) -> dict[str, Any]:
    victim, *healthy = consumers
    first = number * (BEFORE + DURING)
    before = _send(supplier, healthy, range(first, first + BEFORE), first + WARM_UP)
    collect(victim, [range(first, first + BEFORE)], LIMIT_S)
    accounts = {proxy.id: proxy.events for proxy in channel.state().proxies}
    sent = range(first + BEFORE, first + BEFORE + DURING)
    os.kill(victim.pid, signal.SIGSTOP)
    try:
        during = _send(supplier, healthy, sent, sent.start)
        proxy = max(channel.state().proxies, key=lambda proxy: proxy.events.queued).id
    finally:
        os.kill(victim.pid, signal.SIGCONT)
    (got,) = collect(victim, [sent], LIMIT_S)

    def settled() -> Any:
        (account,) = (p.events for p in channel.state().proxies if p.id == proxy)
        return None if account.queued else account

    account = eventually(settled, LIMIT_S, "an empty queue of the stalled one")
    discarded = account.discarded - accounts[proxy].discarded
    # The lost events must be contiguous, and end before those that were in the queue at the end.
    oldest = got["gaps"] == [[sent.stop - BOUND - discarded, sent.stop - BOUND]]
    p99 = [quantile([value for one in phase for value in one["latencies"]], 0.99) for phase in (before, during)]
    return {
        "round": number + 1,
        "p99 before": p99[0],
        "p99 during": p99[1],
        "growth": p99[1] / p99[0],
        "lost by healthy": sum(one["lost"] for one in (*before, *during)),
        "sent during": DURING,
        "stalled one got": got["count"],
        "discarded, its account": discarded,
        "unconfirmed, its account": account.unconfirmed - accounts[proxy].unconfirmed,
        "unaccounted": abs(DURING - got["count"] - discarded) + got["repeated"],
        "not the oldest": 0 if oldest else got["lost"],
    }


def _send(supplier: Process, consumers: list[Process], numbers: range, latencies_from: int) -> list[dict[str, Any]]:
    """Send events at RATE; the result of each consumer."""
    count = len(numbers)
    send(supplier, "pace", count / RATE * 5 + LIMIT_S, first=numbers.start, count=count, rate=RATE)
    return [collect(consumer, [numbers], LIMIT_S, latencies_from)[0] for consumer in consumers]


# ---- the cost of a delivery with 1 to 2,000 consumers ----


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


# ---- growth of the resident memory under steady mixed traffic ----


#: Events a second by supplier, and number of consumers. Every consumer gets every event.
MEMORY_SUPPLIERS = {PLAIN.name: 50.0, HEADER.name: 100.0, CLIENT.name: 50.0}
MEMORY_CONSUMERS = 5
LAP_S = 10.0
SAMPLE_S = 2.0
#: Share of the time in which caches fill, and maximum growth after it.
WARM_UP_SHARE = 0.25
MAX_MIB_AN_HOUR = 2.0
#: Rows of the table.
ROWS = 20


def memory(minutes: float) -> bool:
    """Whether every mark was reached."""
    samples: list[tuple[float, float]] = []
    with Stage() as stage:
        broker = stage.broker(HEADER.name)
        consumer = stage.consumer(BOUNDED.name, broker, MEMORY_CONSUMERS)
        ready(consumer)
        suppliers = {stage.supplier(peer, broker): rate for peer, rate in MEMORY_SUPPLIERS.items()}
        ready(*suppliers)
        channel, began = psutil.Process(broker.pid), time.monotonic()

        def sample() -> None:
            samples.append((time.monotonic() - began, channel.memory_info().rss / 2**20))

        with contextlib.closing(Repeating("memory", sample, SAMPLE_S).start()):
            events, lost = _traffic(suppliers, consumer, minutes * 60)
    rows = [{"minutes": at / 60, "resident, MiB": size} for at, size in samples[:: max(1, len(samples) // ROWS)]]
    seconds, sizes = zip(*samples, strict=True)
    marks = [
        at_most("growth after the warm-up, MiB an hour", slope_an_hour(seconds, sizes), MAX_MIB_AN_HOUR),
        at_most(f"events lost of {events:,} for each of {MEMORY_CONSUMERS} consumers", lost, 0),
    ]
    rate = sum(MEMORY_SUPPLIERS.values())
    title = f"Resident memory of a channel, {rate:g} events a second for {MEMORY_CONSUMERS} consumers"
    draw = curves([at / 60 for at in seconds], {"channel": sizes}, "minutes", ylabel="MiB")
    return summarize("event_channel_memory", title, rows, marks, draw)


def slope_an_hour(seconds: Sequence[float], sizes: Sequence[float]) -> float:
    """Slope of a line fitted to the sizes after the warm-up [1/h]."""
    at, size = np.array(seconds), np.array(sizes)
    counts = at >= at[0] + WARM_UP_SHARE * (at[-1] - at[0])
    return float(np.polyfit(at[counts], size[counts], 1)[0]) * 3600


def _traffic(suppliers: dict[Process, float], consumer: Process, seconds: float) -> tuple[int, int]:
    """Number of events sent, and number of lost events over all consumers."""
    events = lost = 0
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        for supplier, rate in suppliers.items():
            supplier.send({"do": "pace", "first": 0, "count": round(rate * LAP_S), "rate": rate})
        total = sum(sum(supplier.receive(10 * LAP_S)["sent"]) for supplier in suppliers)
        # Only counts: all suppliers have the id 0.
        lost += sum(total - one["count"] for one in collect(consumer, [range(total)], 30.0))
        events += total
        PROGRESS.print(f"memory: {events:,} events, {lost} lost, {left / 60:.1f} min left")
    return events, lost
