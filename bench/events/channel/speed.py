"""Latency at a steady rate and throughput of a flood: supplier, broker and consumer, a process each.

The peers take turns, so that other load of the machine affects all of them. Figures are medians of rounds."""

from __future__ import annotations

import statistics
from collections import defaultdict
from typing import Any, NamedTuple

from bench.events.channel.stage import Stage, collect, send, trio
from testkit.json_process import Process
from testkit.peers import installed
from testkit.peers.brokers import MQTT, REDIS
from testkit.peers.corba import CLIENT, HEADER, OMNIEVENTS, ON_ONE_CORE, PLAIN, PLAIN_TO_BATCHES, RELAY
from testkit.report import PROGRESS, Mark, at_least, at_most, bars, distribution, quantile, summarize

# ---- latency ----


LATENCY_PEERS = [peer.name for peer in (PLAIN, RELAY, OMNIEVENTS, REDIS, HEADER, CLIENT, MQTT)]
#: Events a second.
RATE = 1000.0
#: Events of a turn, and events before it that do not count, because the processes have slept.
TURN, TURN_WARM_UP = 200, 50
#: Maximum ratio of the median of ours, plain, to the median of a peer.
MAX_OF = {OMNIEVENTS.name: 0.6, REDIS.name: 0.7}
ERRORS = ("lost", "repeated", "misordered")

#: By peer: the latencies of each round [us].
Found = dict[str, list[list[float]]]


def latency(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, turns = (3, 5) if quick else (7, 20)
    found: Found = defaultdict(list)
    errors: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(ERRORS, 0))
    with Stage() as stage:
        trios = {name: trio(stage, name) for name in LATENCY_PEERS if name in installed()}
        for number in range(rounds):
            PROGRESS.print(f"latency: round {number + 1} of {rounds}")
            for latencies in (found[name] for name in trios):
                latencies.append([])
            for turn in range(turns):
                for name, (supplier, consumer) in trios.items():
                    got = _turn(supplier, consumer, (number * turns + turn) * (TURN_WARM_UP + TURN))
                    found[name][-1] += got["latencies"]
                    for error in ERRORS:
                        errors[name][error] += got[error]
    rows = [_latency_row(name, found, errors[name]) for name in found]
    title = f"Latency at {RATE:g} events a second, microseconds"
    samples = {name: [us for latencies in results for us in latencies] for name, results in found.items()}
    draw = distribution(samples, "us", "share of events that took less")
    lost = sum(errors[peer.name]["lost"] for peer in (PLAIN, HEADER, CLIENT))
    return summarize("event_channel_latency", title, rows, _latency_marks(found, lost), draw)


def _turn(supplier: Process, consumer: Process, first: int) -> dict[str, Any]:
    count = TURN_WARM_UP + TURN
    send(supplier, "pace", count / RATE * 5 + 30, first=first, count=count, rate=RATE)
    (got,) = collect(consumer, [range(first, first + count)], 20.0, first + TURN_WARM_UP)
    return got


def _latency_row(name: str, found: Found, errors: dict[str, int]) -> dict[str, Any]:
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


def _latency_marks(found: Found, lost: int) -> list[Mark]:
    marks = []
    for peer, limit in MAX_OF.items():
        if peer in found:
            marks.append(at_most(f"p50 of ours, plain / {peer}", _ratio(found, peer, 0.5), limit))
            marks.append(at_most(f"p99 of ours, plain / {peer}", _ratio(found, peer, 0.99), 1.0))
    return [*marks, at_most("events lost by ours", lost, 0)]


# ---- throughput ----


#: Minimum number of events a second that must arrive, one a call and in runs.
ONE_BY_ONE, IN_RUNS = 20_000, 300_000
WARM_UP_S = 0.5
#: Maximum number of events that a consumer keeps.
MOST = 2_000_000
FLOOD_LIMIT_S = 90.0


class Way(NamedTuple):
    """A peer and how it is flooded. threads: number of suppliers. run: events a call, 0 for single events."""

    peer: str
    threads: int = 1
    run: int = 0

    @property
    def label(self) -> str:
        """Text for the table; the number of threads if there are several."""
        how = f", {self.threads} threads" if self.threads > 1 else ""
        return f"{self.peer}{how}, runs of {self.run}" if self.run else f"{self.peer}{how}"


BEST_RUNS = Way(HEADER.name, run=100)
WAYS = [
    Way(PLAIN.name),
    Way(PLAIN_TO_BATCHES.name),
    Way(PLAIN_TO_BATCHES.name, 4),
    Way(HEADER.name),
    Way(HEADER.name, 2),
    Way(HEADER.name, 4),
    Way(ON_ONE_CORE.name, 4),
    Way(CLIENT.name, 4),
    BEST_RUNS,
    Way(CLIENT.name, run=100),
    Way(OMNIEVENTS.name),
    Way(REDIS.name),
    Way(REDIS.name, run=100),
    Way(MQTT.name),
]


def throughput(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, seconds = (2, 1.0) if quick else (5, 2.0)
    found: dict[Way, list[dict[str, Any]]] = {way: [] for way in WAYS if way.peer in installed()}
    for number in range(rounds):
        for way, results in found.items():
            with Stage() as stage:
                supplier, consumer = trio(stage, way.peer)
                _flood(way, supplier, consumer, 0, WARM_UP_S)
                results.append(_flood(way, supplier, consumer, MOST, seconds))
                rate, lost = results[-1]["rate"], results[-1]["lost"]
                PROGRESS.print(f"round {number + 1} of {rounds}: {way.label}: {rate:,.0f}/s, {lost} lost")
    rows = [_throughput_row(way, results) for way, results in found.items()]
    draw = bars({row["peer"]: row["events/s"] for row in rows}, "events a second that arrive", "log")
    return summarize(
        "event_channel_throughput", "Flood: events that arrive each second", rows, _throughput_marks(rows), draw
    )


def _flood(way: Way, supplier: Process, consumer: Process, first: int, seconds: float) -> dict[str, Any]:
    how, more = ("runs", {"size": way.run}) if way.run else ("flood", {"threads": way.threads})
    answer = send(supplier, how, FLOOD_LIMIT_S, first=first, seconds=seconds, most=MOST, **more)
    sent = [range(first, first + count) for count in answer["sent"]]
    (got,) = collect(consumer, sent, FLOOD_LIMIT_S)
    took_s = max(1, got["last"] - answer["began"]) / 1e9
    return {**got, "sent": sum(map(len, sent)), "rate": got["count"] / took_s, "failed": answer["failed"]}


def _throughput_row(way: Way, results: list[dict[str, Any]]) -> dict[str, Any]:
    rates = [one["rate"] for one in results]
    return {
        "peer": way.label,
        "events/s": statistics.median(rates),
        "worst round": min(rates),
        "best round": max(rates),
        "sent": sum(one["sent"] for one in results),
        **{column: sum(one[column] for one in results) for column in ("lost", "repeated", "misordered")},
        "failed calls": sum(one["failed"] for one in results),
    }


def _throughput_marks(rows: list[dict[str, Any]]) -> list[Mark]:
    rate = {row["peer"]: row["events/s"] for row in rows}
    lossless = [row for row in rows if row["peer"].startswith("ours") and row["peer"] != PLAIN.name]
    one_by_one = max(rate[way.label] for way in WAYS if way.peer.startswith("ours") and not way.run)
    return [
        at_least("one event a call, events/s", one_by_one, ONE_BY_ONE),
        at_least("runs of 100, events/s", rate[BEST_RUNS.label], IN_RUNS),
        at_most("events of ours lost", sum(row["lost"] for row in lossless), 0),
        at_most("events of ours out of order or twice", sum(r["misordered"] + r["repeated"] for r in lossless), 0),
    ]
