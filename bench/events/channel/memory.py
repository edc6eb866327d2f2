"""Growth of the resident memory of a channel under steady mixed traffic."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence

import numpy as np
import psutil

from bench.common.processes import Process
from bench.events.channel.peers.corba import BOUNDED, CLIENT, HEADER, PLAIN
from bench.events.channel.stage import Stage, collect, ready
from robocorba.repeating import Repeating
from robocorba.testing.report import PROGRESS, at_most, curves, summarize

#: Events a second by supplier, and number of consumers. Every consumer gets every event.
SUPPLIERS = {PLAIN.name: 50.0, HEADER.name: 100.0, CLIENT.name: 50.0}
CONSUMERS = 5
LAP_S = 10.0
SAMPLE_S = 2.0
#: Share of the time in which caches fill, and maximum growth after it.
WARM_UP_SHARE = 0.25
MAX_MIB_AN_HOUR = 2.0
#: Rows of the table.
ROWS = 20


def measure(minutes: float) -> bool:
    """Whether every mark was reached."""
    samples: list[tuple[float, float]] = []
    with Stage() as stage:
        broker = stage.broker(HEADER.name)
        consumer = stage.consumer(BOUNDED.name, broker, CONSUMERS)
        ready(consumer)
        suppliers = {stage.supplier(peer, broker): rate for peer, rate in SUPPLIERS.items()}
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
        at_most(f"events lost of {events:,} for each of {CONSUMERS} consumers", lost, 0),
    ]
    title = f"Resident memory of a channel, {sum(SUPPLIERS.values()):g} events a second for {CONSUMERS} consumers"
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
