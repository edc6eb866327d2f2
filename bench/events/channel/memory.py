"""Growth of the resident memory of a channel under steady mixed traffic."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import numpy as np
import psutil
from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.processes import Process
from bench.events.channel.peers.ours import BOUNDED, CLIENT, HEADER, PLAIN
from bench.events.channel.stage import Stage, collect, ready
from robocorba.testing.report import PROGRESS, at_most, summarize

#: Events a second by supplier, and number of consumers by their process. Every consumer gets every event.
SUPPLIERS = {PLAIN.name: 50.0, HEADER.name: 100.0, CLIENT.name: 50.0}
CONSUMERS = {BOUNDED.name: 5}
LAP_S = 10.0
SAMPLE_S = 2.0
#: Share of the time in which caches fill, and maximum growth after it.
WARM_UP_SHARE = 0.25
MAX_MIB_AN_HOUR = 2.0
MIB = 2**20
#: Rows of the table.
ROWS = 20


def run(minutes: float) -> bool:
    """Whether every mark was reached."""
    samples: list[tuple[float, float]] = []
    with Stage() as stage:
        broker = stage.broker(HEADER.name)
        consumers = [stage.consumer(peer, broker, count) for peer, count in CONSUMERS.items()]
        ready(*consumers)
        suppliers = {stage.supplier(peer, broker): rate for peer, rate in SUPPLIERS.items()}
        ready(*suppliers)
        ended = threading.Event()
        watcher = threading.Thread(target=_watch, args=(psutil.Process(broker.pid), samples, ended), daemon=True)
        watcher.start()
        try:
            events, lost = _traffic(suppliers, consumers, minutes * 60)
        finally:
            ended.set()
            watcher.join(10)
    step = max(1, len(samples) // ROWS)
    rows = [{"minutes": at / 60, "resident, MiB": size} for at, size in samples[::step]]
    slope = slope_an_hour(*zip(*samples, strict=True))
    marks = [
        at_most("growth after the warm-up, MiB an hour", slope, MAX_MIB_AN_HOUR),
        at_most(f"events lost of {events:,} for each of {sum(CONSUMERS.values())} consumers", lost, 0),
    ]
    traffic = f"{sum(SUPPLIERS.values()):g} events a second for {sum(CONSUMERS.values())} consumers"
    title = f"Resident memory of a channel, {traffic}"
    return summarize(RESULTS / "event_channel_memory", title, rows, marks, lambda axes: _draw(axes, samples))


def slope_an_hour(seconds: Sequence[float], sizes: Sequence[float]) -> float:
    """Slope of a line fitted to the sizes after the warm-up [1/h]."""
    start = seconds[0] + WARM_UP_SHARE * (seconds[-1] - seconds[0])
    points = [(at, size) for at, size in zip(seconds, sizes, strict=True) if at >= start]
    at, size = zip(*points, strict=True)
    return float(np.polyfit(at, size, 1)[0]) * 3600


def _traffic(suppliers: dict[Process, float], consumers: list[Process], seconds: float) -> tuple[int, int]:
    """Number of events sent, and number of lost events over all consumers."""
    events = lost = 0
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        counts = [round(rate * LAP_S) for rate in suppliers.values()]
        for (supplier, rate), count in zip(suppliers.items(), counts, strict=True):
            supplier.send({"do": "pace", "first": 0, "count": count, "rate": rate})
        for supplier in suppliers:
            supplier.receive(10 * LAP_S)
        total = sum(counts)
        for consumer in consumers:  # only counts: all suppliers have the id 0
            lost += sum(total - one["count"] for one in collect(consumer, [range(total)], 30.0))
        events += total
        left = max(0.0, until - time.monotonic())
        PROGRESS.print(f"memory: {events:,} events, {lost} lost, {left / 60:.1f} min left")
    return events, lost


def _watch(process: psutil.Process, samples: list[tuple[float, float]], ended: threading.Event) -> None:
    began = time.monotonic()
    while not ended.wait(SAMPLE_S):
        samples.append((time.monotonic() - began, process.memory_info().rss / MIB))


def _draw(axes: Axes, samples: list[tuple[float, float]]) -> None:
    axes.plot([at / 60 for at, _ in samples], [size for _, size in samples])
    axes.set(xlabel="minutes", ylabel="MiB")
