"""Latency at a steady rate: supplier, broker and consumer, a process each, on an otherwise idle machine.

The peers take short turns, so that other load of the machine affects all of them. Figures are medians of rounds.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from typing import Any

from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.processes import Process
from bench.events.channel.peers import installed
from bench.events.channel.peers.mosquitto import PEER as MQTT
from bench.events.channel.peers.nats import PEER as NATS
from bench.events.channel.peers.omnievents import PEER as OMNIEVENTS
from bench.events.channel.peers.ours import CLIENT, HEADER, PLAIN
from bench.events.channel.peers.redis import PEER as REDIS
from bench.events.channel.peers.relay import PEER as RELAY
from bench.events.channel.peers.zenoh import PEER as ZENOH
from bench.events.channel.peers.zeromq import PEER as ZEROMQ
from bench.events.channel.stage import Stage, collect, trio
from robocorba.testing.report import PROGRESS, Mark, at_most, quantile, summarize

PEERS = [peer.name for peer in (PLAIN, RELAY, OMNIEVENTS, REDIS, HEADER, CLIENT, MQTT, NATS, ZEROMQ, ZENOH)]
#: Events a second.
RATE = 1000.0
#: Events of a turn, and events before it that do not count, because the processes have slept.
TURN, WARM_UP = 200, 50
#: Maximum ratio of the median of ours, plain, to the median of a peer.
MAX_OF = {OMNIEVENTS.name: 0.6, REDIS.name: 0.7}

#: By peer: the results of each round or turn.
Found = dict[str, list[dict[str, Any]]]


def run(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, turns = (3, 5) if quick else (7, 20)
    results: Found = defaultdict(list)
    with Stage() as stage:
        peers = [name for name in PEERS if name in installed()]
        trios = {name: trio(stage, name) for name in peers}
        for number in range(rounds):
            PROGRESS.print(f"latency: round {number + 1} of {rounds}")
            found: Found = {name: [] for name in peers}
            for turn in range(turns):
                for name in peers:
                    _, supplier, consumer = trios[name]
                    found[name].append(_turn(supplier, consumer, (number * turns + turn) * (WARM_UP + TURN)))
            for name in peers:
                results[name].append(_together(found[name]))
    rows = [_row(name, rounds, _ratio(results, name, 0.5)) for name, rounds in results.items()]
    title = f"Latency at {RATE:g} events a second, microseconds"
    return summarize(RESULTS / "event_channel_latency", title, rows, _marks(results), lambda axes: _draw(axes, results))


def _turn(supplier: Process, consumer: Process, first: int) -> dict[str, Any]:
    count = WARM_UP + TURN
    supplier.send({"do": "pace", "first": first, "count": count, "rate": RATE})
    supplier.receive(count / RATE * 5 + 30)
    (got,) = collect(consumer, [range(first, first + count)], 20.0, first + WARM_UP)
    return got


def _together(turns: list[dict[str, Any]]) -> dict[str, Any]:
    """The results of the turns of a round, merged."""
    latencies = [value for turn in turns for value in turn["latencies"]]
    counts = {column: sum(turn[column] for turn in turns) for column in ("lost", "repeated", "misordered")}
    return {"latencies": latencies, **counts}


def _row(name: str, found: list[dict[str, Any]], ratio: float) -> dict[str, Any]:
    return {
        "peer": name,
        "p50": statistics.median(quantile(one["latencies"], 0.5) for one in found),
        "p99": statistics.median(quantile(one["latencies"], 0.99) for one in found),
        "p50, worst round": max(quantile(one["latencies"], 0.5) for one in found),
        "lost": sum(one["lost"] for one in found),
        "repeated": sum(one["repeated"] for one in found),
        "misordered": sum(one["misordered"] for one in found),
        "p50 of ours, plain / this": ratio,
    }


def _ratio(results: Found, peer: str, share: float) -> float:
    """Ratio of ours, plain, to a peer: the median of the ratios of the rounds."""
    pairs = zip(results[PLAIN.name], results[peer], strict=True)
    return statistics.median(quantile(o["latencies"], share) / quantile(p["latencies"], share) for o, p in pairs)


def _marks(results: Found) -> list[Mark]:
    marks = []
    for peer, limit in MAX_OF.items():
        if peer in results:
            marks.append(at_most(f"p50 of ours, plain / {peer}", _ratio(results, peer, 0.5), limit))
            marks.append(at_most(f"p99 of ours, plain / {peer}", _ratio(results, peer, 0.99), 1.0))
    ours = (PLAIN.name, HEADER.name, CLIENT.name)
    marks.append(at_most("events lost by ours", sum(one["lost"] for name in ours for one in results[name]), 0))
    return marks


def _draw(axes: Axes, results: Found) -> None:
    for name, found in results.items():
        ordered = sorted(value for one in found for value in one["latencies"])
        axes.plot(ordered, [place / len(ordered) for place in range(len(ordered))], label=name)
    axes.set(xscale="log", xlabel="us", ylabel="share of events that took less")
    axes.legend()
