"""Latency at a steady rate, throughput of a flood, and the cost of a delivery to many consumers.

The peers take turns, so that other load of the machine affects all of them. Figures are medians of rounds."""

from __future__ import annotations

import contextlib
import itertools
import statistics
from collections import defaultdict
from typing import Any, NamedTuple

from bench.common.harness import progress
from bench.events.channel.processes import Stage
from testkit.json_process import Cpu
from testkit.peers import installed
from testkit.peers.brokers import MQTT, REDIS
from testkit.peers.corba import CLIENT, HEADER, OMNIEVENTS, ON_ONE_CORE, PLAIN, PLAIN_TO_BATCHES
from testkit.report import at_least, at_most, quantile, summarize

ERRORS = ("lost", "repeated", "misordered")
#: Time limit of a turn or flood [s].
LIMIT_S = 90.0


# ---- latency ----


LATENCY_PEERS = [peer.name for peer in (PLAIN, OMNIEVENTS, REDIS, HEADER, CLIENT, MQTT)]
#: Events a second.
RATE = 1000.0
#: Events of a turn, and events before it that do not count, because the processes have slept.
TURN, TURN_WARM_UP = 200, 50
#: Maximum ratio of the median of ours, plain, to the median of a peer.
MAX_OF = {OMNIEVENTS.name: 0.6, REDIS.name: 0.7}


def latency(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, turns, count = (3, 5, TURN_WARM_UP + TURN) if quick else (7, 20, TURN_WARM_UP + TURN)
    #: The latencies of each round [us].
    found: dict[str, list[list[float]]] = {name: [] for name in LATENCY_PEERS if name in installed()}
    errors: dict[str, dict[str, int]] = {name: dict.fromkeys(ERRORS, 0) for name in found}
    with contextlib.ExitStack() as stack:
        stages = {name: stack.enter_context(Stage(name)) for name in found}
        for number, name in progress([*itertools.product(range(turns), found)] * rounds, "latency"):
            if number == 0:
                found[name].append([])
            first = (len(found[name]) * turns + number) * count
            pace = {"first": first, "count": count, "rate": RATE}
            _, (got,) = stages[name].send("pace", LIMIT_S, first + TURN_WARM_UP, **pace)
            found[name][-1] += got["latencies"]
            for error in ERRORS:
                errors[name][error] += got[error]

    def ratio(peer: str, share: float) -> float:
        """Ratio of ours, plain, to a peer: the median of the ratios of the rounds."""
        pairs = zip(found[PLAIN.name], found[peer], strict=True)
        return statistics.median(quantile(ours, share) / quantile(theirs, share) for ours, theirs in pairs)

    rows = [
        {
            "peer": name,
            "p50": statistics.median(quantile(one, 0.5) for one in some),
            "p99": statistics.median(quantile(one, 0.99) for one in some),
            **errors[name],
            "p50 of ours, plain / this": ratio(name, 0.5),
        }
        for name, some in found.items()
    ]
    marks = [at_most("events lost by ours", sum(errors[peer.name]["lost"] for peer in (PLAIN, HEADER, CLIENT)), 0)]
    for peer in (peer for peer in MAX_OF if peer in found):
        marks.append(at_most(f"p50 of ours, plain / {peer}", ratio(peer, 0.5), MAX_OF[peer]))
        marks.append(at_most(f"p99 of ours, plain / {peer}", ratio(peer, 0.99), 1.0))
    samples = {name: list(itertools.chain(*some)) for name, some in found.items()}
    return summarize(
        "event_channel_latency", f"Latency at {RATE:g} events a second, microseconds", rows, marks, samples, "us"
    )


# ---- throughput ----


#: Minimum number of events a second that must arrive, one a call and in runs.
ONE_BY_ONE, IN_RUNS = 20_000, 300_000
WARM_UP_S = 0.5
#: Maximum number of events that a consumer keeps.
MOST = 2_000_000


class Way(NamedTuple):
    """A peer and how it is flooded. threads: number of suppliers. size: events a call."""

    peer: str
    threads: int = 1
    size: int = 1

    @property
    def label(self) -> str:
        """Text for the table."""
        threads = f", {self.threads} threads" if self.threads > 1 else ""
        return f"{self.peer}{threads}{f', runs of {self.size}' if self.size > 1 else ''}"


BEST_RUNS = Way(HEADER.name, size=100)
WAYS = [
    *(Way(PLAIN.name), Way(PLAIN_TO_BATCHES.name), Way(PLAIN_TO_BATCHES.name, 4)),
    *(Way(HEADER.name), Way(HEADER.name, 2), Way(HEADER.name, 4), Way(ON_ONE_CORE.name, 4), BEST_RUNS),
    *(Way(CLIENT.name, 4), Way(CLIENT.name, size=100)),
    *(Way(OMNIEVENTS.name), Way(REDIS.name), Way(REDIS.name, size=100), Way(MQTT.name)),
]


def throughput(quick: bool) -> bool:
    """Whether every mark was reached."""
    rounds, seconds = (2, 1.0) if quick else (5, 2.0)
    found: dict[Way, list[dict[str, Any]]] = defaultdict(list)
    for way in progress([way for way in WAYS if way.peer in installed()] * rounds, "throughput"):
        how = {"most": MOST, "threads": way.threads, "size": way.size}
        with Stage(way.peer) as stage:
            stage.send("flood", LIMIT_S, first=0, seconds=WARM_UP_S, **how)
            answer, (got,) = stage.send("flood", LIMIT_S, first=MOST, seconds=seconds, **how)
            rate = got["count"] / (max(1, got["last"] - answer["began"]) / 1e9)
            found[way].append({**got, "rate": rate, "failed calls": answer["failed"]})
    rows: list[dict[str, Any]] = [
        {
            "peer": way.label,
            "events/s": statistics.median(one["rate"] for one in results),
            "worst round": min(one["rate"] for one in results),
            "best round": max(one["rate"] for one in results),
            **{column: sum(one[column] for one in results) for column in (*ERRORS, "failed calls")},
        }
        for way, results in found.items()
    ]
    samples = {way.label: [one["rate"] for one in results] for way, results in found.items()}
    rate = {row["peer"]: row["events/s"] for row in rows}
    lossless = [row for row in rows if row["peer"].startswith("ours") and row["peer"] != PLAIN.name]
    one_by_one = max(rate[way.label] for way in WAYS if way.peer.startswith("ours") and way.size == 1)
    marks = [
        at_least("one event a call, events/s", one_by_one, ONE_BY_ONE),
        at_least("runs of 100, events/s", rate[BEST_RUNS.label], IN_RUNS),
        at_most("events of ours lost", sum(row["lost"] for row in lossless), 0),
        at_most("events of ours out of order or twice", sum(r["misordered"] + r["repeated"] for r in lossless), 0),
    ]
    return summarize(
        "event_channel_throughput", "Flood: events that arrive each second", rows, marks, samples, "events/s"
    )


# ---- fan-out ----


CONSUMERS, PROCESSES = (1, 10, 100, 300, 1000, 2000), 4
FANOUT_WAYS = (PLAIN.name, HEADER.name)
#: Maximum ratio of the cost of a delivery with many consumers to that with one.
MAX_COST_GROWTH = 1.5
#: Minimum ratio of the deliveries a second with more than MANY consumers to those with MANY.
MANY, MIN_RATE_KEPT = 100, 0.7
#: Events of a flood: the longer it lasts, the more of them go in one call, so those with MANY or more have as many.
MIN_EVENTS, MAX_EVENTS, DELIVERIES = 100, 5000, 10_000
FANOUT_LIMIT_S = 120.0


def fanout(quick: bool) -> bool:
    """Whether every mark was reached."""
    found: dict[tuple[str, int], list[dict[str, float]]] = defaultdict(list)
    rounds = 2 if quick else 5
    for peer, count in progress([*itertools.product(FANOUT_WAYS, CONSUMERS)] * rounds, "fan-out"):
        found[peer, count].append(_fanout_round(peer, count))
    rows: list[dict[str, Any]] = [
        {
            "consumers are": peer,
            "consumers": count,
            **{what: statistics.median(one[what] for one in results) for what in results[0]},
            "lost": sum(one["lost"] for one in results),
        }
        for (peer, count), results in found.items()
    ]
    marks = [at_most("events lost", sum(row["lost"] for row in rows), 0)]
    for peer in FANOUT_WAYS:
        some = [row for row in rows if row["consumers are"] == peer]
        rate = {row["consumers"]: row["deliveries/s"] for row in some}
        kept = min(rate[count] for count in CONSUMERS if count > MANY) / rate[MANY]
        marks.append(at_least(f"{peer}: deliveries/s, worst of more than {MANY} / {MANY}", kept, MIN_RATE_KEPT))
        growth = max(row["CPU, us"] for row in some) / some[0]["CPU, us"]
        marks.append(at_most(f"{peer}: CPU of a delivery, worst / one consumer", growth, MAX_COST_GROWTH))
    title = "Deliveries of one channel, and CPU time of its process"
    samples = {f"{peer}, {count}": [one["deliveries/s"] for one in some] for (peer, count), some in found.items()}
    return summarize("event_channel_fanout", title, rows, marks, samples, "deliveries/s")


def _fanout_round(peer: str, count: int) -> dict[str, float]:
    shares = [count // PROCESSES + (place < count % PROCESSES) for place in range(min(PROCESSES, count))]
    events = max(MIN_EVENTS, min(MAX_EVENTS, DELIVERIES // count))
    with Stage(peer, shares) as stage:
        stage.send("flood", FANOUT_LIMIT_S, first=0, seconds=FANOUT_LIMIT_S, most=max(20, events // 10))
        cpu = Cpu([stage.broker.pid])
        answer, got = stage.send("flood", FANOUT_LIMIT_S, first=MOST, seconds=FANOUT_LIMIT_S, most=events)
        cpu_us = cpu.spent_s()[0] * 1e6 / (events * count)
        took_s = (max(one["last"] for one in got) - answer["began"]) / 1e9
        found: dict[str, float] = {"to subscribe, s": stage.subscribed_s, "CPU, us": cpu_us}
        return {**found, "deliveries/s": events * count / took_s, "lost": sum(one["lost"] for one in got)}
