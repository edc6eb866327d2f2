"""Latency at a steady rate: supplier, broker and consumer, a process each, on an otherwise idle machine.

The peers take short turns, so that other load of the machine affects all of them. Figures are medians of rounds.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from typing import Any

from bench.common.processes import Process
from bench.events.channel.peers import installed
from bench.events.channel.peers.brokers import MQTT, NATS, REDIS, ZENOH, ZEROMQ
from bench.events.channel.peers.corba import CLIENT, HEADER, OMNIEVENTS, PLAIN, RELAY
from bench.events.channel.stage import Stage, collect, send, trio
from robocorba.testing.report import PROGRESS, Mark, at_most, distribution, quantile, summarize

PEERS = [peer.name for peer in (PLAIN, RELAY, OMNIEVENTS, REDIS, HEADER, CLIENT, MQTT, NATS, ZEROMQ, ZENOH)]
#: Events a second.
RATE = 1000.0
#: Events of a turn, and events before it that do not count, because the processes have slept.
TURN, WARM_UP = 200, 50
#: Maximum ratio of the median of ours, plain, to the median of a peer.
MAX_OF = {OMNIEVENTS.name: 0.6, REDIS.name: 0.7}
ERRORS = ("lost", "repeated", "misordered")

#: By peer: the latencies of each round [us].
Found = dict[str, list[list[float]]]


def measure(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, turns = (3, 5) if quick else (7, 20)
    found: Found = defaultdict(list)
    errors: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(ERRORS, 0))
    with Stage() as stage:
        trios = {name: trio(stage, name) for name in PEERS if name in installed()}
        for number in range(rounds):
            PROGRESS.print(f"latency: round {number + 1} of {rounds}")
            for latencies in (found[name] for name in trios):
                latencies.append([])
            for turn in range(turns):
                for name, (supplier, consumer) in trios.items():
                    got = _turn(supplier, consumer, (number * turns + turn) * (WARM_UP + TURN))
                    found[name][-1] += got["latencies"]
                    for error in ERRORS:
                        errors[name][error] += got[error]
    rows = [_row(name, found, errors[name]) for name in found]
    title = f"Latency at {RATE:g} events a second, microseconds"
    samples = {name: [us for latencies in results for us in latencies] for name, results in found.items()}
    draw = distribution(samples, "us", "share of events that took less")
    lost = sum(errors[peer.name]["lost"] for peer in (PLAIN, HEADER, CLIENT))
    return summarize("event_channel_latency", title, rows, _marks(found, lost), draw)


def _turn(supplier: Process, consumer: Process, first: int) -> dict[str, Any]:
    count = WARM_UP + TURN
    send(supplier, "pace", count / RATE * 5 + 30, first=first, count=count, rate=RATE)
    (got,) = collect(consumer, [range(first, first + count)], 20.0, first + WARM_UP)
    return got


def _row(name: str, found: Found, errors: dict[str, int]) -> dict[str, Any]:
    medians = [quantile(latencies, 0.5) for latencies in found[name]]
    return {
        "peer": name,
        "p50": statistics.median(medians),
        "p99": statistics.median(quantile(latencies, 0.99) for latencies in found[name]),
        "p50, worst round": max(medians),
        **errors,
        "p50 of ours, plain / this": _ratio(found, name, 0.5),
    }


def _ratio(found: Found, peer: str, share: float) -> float:
    """Ratio of ours, plain, to a peer: the median of the ratios of the rounds."""
    pairs = zip(found[PLAIN.name], found[peer], strict=True)
    return statistics.median(quantile(ours, share) / quantile(theirs, share) for ours, theirs in pairs)


def _marks(found: Found, lost: int) -> list[Mark]:
    marks = []
    for peer, limit in MAX_OF.items():
        if peer in found:
            marks.append(at_most(f"p50 of ours, plain / {peer}", _ratio(found, peer, 0.5), limit))
            marks.append(at_most(f"p99 of ours, plain / {peer}", _ratio(found, peer, 0.99), 1.0))
    return [*marks, at_most("events lost by ours", lost, 0)]
