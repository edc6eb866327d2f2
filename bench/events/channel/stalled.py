"""One of ten consumers, a process each, is stopped (SIGSTOP): the effect on the other nine, and whether the stopped one
loses exactly the events that exceed its queue."""

from __future__ import annotations

import os
import signal
import statistics
from typing import Any

from bench.common.processes import Process
from bench.events.channel.peers.corba import BOUND, BOUNDED, connected
from bench.events.channel.stage import Stage, collect, ready, send
from robocorba.testing.processes import eventually
from robocorba.testing.report import PROGRESS, at_most, curves, quantile, summarize

HEALTHY = 9
RATE = 200.0
#: Events before the stop, of which the first do not count, and during it: more than fit into the queue of a consumer.
BEFORE, WARM_UP, DURING = 1000, 100, 3 * BOUND
#: Maximum growth of the p99 latency of the healthy consumers.
MAX_GROWTH = 1.5
_LIMIT_S = 60.0


def measure(quick: bool) -> bool:
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
                rounds.append(_round(channel, supplier, consumers, number))
                PROGRESS.print(f"stalled: round {number + 1}: p99 x {rounds[-1]['growth']:.2f}")
    growth = statistics.median(r["growth"] for r in rounds)
    marks = [
        at_most("growth of the p99 of the healthy, median of rounds", growth, MAX_GROWTH),
        at_most("events that the healthy lost", sum(r["lost by healthy"] for r in rounds), 0),
        at_most("events beside the account of the stalled one", sum(r["unaccounted"] for r in rounds), 0),
        at_most("events that it lost though younger than others it got", sum(r["not the oldest"] for r in rounds), 0),
    ]
    title = f"One of {HEALTHY + 1} consumers stopped at {RATE:g} events a second, latency of the others in us"
    p99 = {column: [one[column] for one in rounds] for column in ("p99 before", "p99 during")}
    draw = curves([one["round"] for one in rounds], p99, "round", ylabel="us", ylim=(0, None))
    return summarize("event_channel_stalled", title, rounds, marks, draw)


def _round(channel: Any, supplier: Process, consumers: list[Process], number: int) -> dict[str, Any]:
    stalled, *healthy = consumers
    first = number * (BEFORE + DURING)
    before = _send(supplier, healthy, range(first, first + BEFORE), first + WARM_UP)
    collect(stalled, [range(first, first + BEFORE)], _LIMIT_S)
    accounts = {proxy.id: proxy.events for proxy in channel.state().proxies}
    sent = range(first + BEFORE, first + BEFORE + DURING)
    os.kill(stalled.pid, signal.SIGSTOP)
    try:
        during = _send(supplier, healthy, sent, sent.start)
        proxy = max(channel.state().proxies, key=lambda proxy: proxy.events.queued).id
    finally:
        os.kill(stalled.pid, signal.SIGCONT)
    (got,) = collect(stalled, [sent], _LIMIT_S)

    def settled() -> Any:
        (account,) = (p.events for p in channel.state().proxies if p.id == proxy)
        return None if account.queued else account

    account = eventually(settled, _LIMIT_S, "an empty queue of the stalled one")
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
    send(supplier, "pace", count / RATE * 5 + _LIMIT_S, first=numbers.start, count=count, rate=RATE)
    return [collect(consumer, [numbers], _LIMIT_S, latencies_from)[0] for consumer in consumers]
