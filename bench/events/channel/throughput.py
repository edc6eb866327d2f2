"""Throughput of a flood: events that arrive a second at one consumer, and their losses and order.

Suppliers send for some seconds as fast as their client library allows; the time ends with the last arrival.
"""

from __future__ import annotations

import statistics
from typing import Any, NamedTuple

from bench.common.processes import Process
from bench.events.channel.peers import installed
from bench.events.channel.peers.brokers import MQTT, NATS, REDIS, ZENOH, ZEROMQ
from bench.events.channel.peers.corba import CLIENT, HEADER, OMNIEVENTS, ON_ONE_CORE, PLAIN, PLAIN_TO_BATCHES
from bench.events.channel.stage import Stage, collect, send, trio
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, bars, summarize

#: Minimum number of events a second that must arrive, one a call and in runs.
ONE_BY_ONE, IN_RUNS = 20_000, 300_000
WARM_UP_S = 0.5
#: Maximum number of events that a consumer keeps.
MOST = 2_000_000
_LIMIT_S = 90.0


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


BEST_RUNS, ZENOH_WAY = Way(HEADER.name, run=100), Way(ZENOH.name)
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
    Way(NATS.name),
    Way(ZEROMQ.name),
    ZENOH_WAY,
]


def measure(quick: bool) -> bool:
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
    rows = [_row(way, results) for way, results in found.items()]
    draw = bars({row["peer"]: row["events/s"] for row in rows}, "events a second that arrive", "log")
    return summarize("event_channel_throughput", "Flood: events that arrive each second", rows, _marks(rows), draw)


def _flood(way: Way, supplier: Process, consumer: Process, first: int, seconds: float) -> dict[str, Any]:
    how, more = ("runs", {"size": way.run}) if way.run else ("flood", {"threads": way.threads})
    answer = send(supplier, how, _LIMIT_S, first=first, seconds=seconds, most=MOST, **more)
    sent = [range(first, first + count) for count in answer["sent"]]
    (got,) = collect(consumer, sent, _LIMIT_S)
    took_s = max(1, got["last"] - answer["began"]) / 1e9
    return {**got, "sent": sum(map(len, sent)), "rate": got["count"] / took_s, "failed": answer["failed"]}


def _row(way: Way, results: list[dict[str, Any]]) -> dict[str, Any]:
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


def _marks(rows: list[dict[str, Any]]) -> list[Mark]:
    rate = {row["peer"]: row["events/s"] for row in rows}
    lossless = [row for row in rows if row["peer"].startswith("ours") and row["peer"] != PLAIN.name]
    one_by_one = max(rate[way.label] for way in WAYS if way.peer.startswith("ours") and not way.run)
    marks = [
        at_least("one event a call, events/s", one_by_one, ONE_BY_ONE),
        at_least("runs of 100, events/s", rate[BEST_RUNS.label], IN_RUNS),
        at_most("events of ours lost", sum(row["lost"] for row in lossless), 0),
        at_most("events of ours out of order or twice", sum(r["misordered"] + r["repeated"] for r in lossless), 0),
    ]
    if ZENOH_WAY.label in rate:
        marks.append(at_least("runs of 100 / Zenoh", rate[BEST_RUNS.label] / rate[ZENOH_WAY.label], 1.0))
    return marks
