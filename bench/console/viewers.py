"""The console beside 50 robots, 8 with lasers and 3 with arms: updates, delay and cost in a browser and for 8 viewers.

python -m bench.console.viewers [--seconds S] [--robots N] [--viewers N]

It needs Chromium, which draws without a graphics card, and keeps a picture of each page. The delay is from the step of
the simulation to the picture."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from bench.common.harness import folder_of_bench, run
from bench.console.crowd import FLOOR, Clock, crowded_system
from robocorba.system.names import CONSOLE
from robocorba.system.state_folder import StateFolder
from testkit.browser import chromium, headless
from testkit.json_process import Cpu, pids_of
from testkit.report import PROGRESS, RESULTS, at_least, at_most, bars, quantile, summarize

NAME = "console_viewers"
#: Time for a page to draw at its final rate before the measurement [s].
SETTLE_S = 6.0
MONITOR_SIZE, SCENE_SIZE = {"width": 1366, "height": 768}, {"width": 1000, "height": 737}

#: Notes the browser's time [ms since 1970] and the simulated time [s] of each update, once it is drawn.
_WATCH = """async floor => { const { live } = await import("/static/live.js"); window.drawn = []; let last = -1;
    live.listen((kind, name) => kind === "floor" && name === floor && requestAnimationFrame(() => setTimeout(() => {
        const time = live.floors.get(floor).time;
        if (time !== last) { last = time; window.drawn.push([Date.now(), time]); } }, 0))); }"""
_PICTURES = "() => document.querySelector('.console-scene canvas').sceneView.pictures"


@contextlib.contextmanager
def crowded_console(folder: Path, count: int) -> Iterator[tuple[str, int, Clock]]:
    """A console beside `count` driving robots: its address, its process id, and the simulation's clock."""
    with crowded_system(folder, count, "--console", "--console-port", "0") as (_, clock, _):
        record = StateFolder(folder).read_record()
        assert record is not None
        yield record.console_address, pids_of(folder, CONSOLE)[0], clock


def measured(clock: Clock, pid: int, seconds: float) -> dict[str, float]:
    """Pace of the simulation and load of the console over `seconds`."""
    since, cpu = len(clock.samples) - 1, Cpu([pid])
    time.sleep(seconds)
    return {"pace": clock.pace(since), "console cores": cpu.spent_s()[0] / seconds}


def in_browser(address: str, pid: int, clock: Clock, seconds: float, browser: str) -> tuple[dict[str, Any], ...]:
    """Rows of the monitor and of the 3D page."""
    with headless(browser) as started:
        page = started.new_page(viewport=MONITOR_SIZE)  # type: ignore[arg-type]
        page.goto(address)
        page.wait_for_timeout(SETTLE_S * 1e3)
        page.evaluate(_WATCH, FLOOR)
        monitor = measured(clock, pid, seconds)
        drawn = page.evaluate("() => window.drawn")
        delays = [at / 1e3 - wall for (at, _), wall in zip(drawn, clock.at([t for _, t in drawn]), strict=True)]
        page.screenshot(path=RESULTS / "console_monitor.png")
        page.set_viewport_size(SCENE_SIZE)  # type: ignore[arg-type]
        page.goto(f"{address}3d")
        page.wait_for_timeout(2 * SETTLE_S * 1e3)
        before, began = page.evaluate(_PICTURES), time.monotonic()
        scene = measured(clock, pid, seconds)
        pictures = (page.evaluate(_PICTURES) - before) / (time.monotonic() - began)
        page.screenshot(path=RESULTS / "console_3d.png")
    return (
        {"viewers": "monitor", "updates/s": len(drawn) / seconds, "p95 ms": 1e3 * quantile(delays, 0.95), **monitor},
        {"viewers": "3D", "updates/s": pictures, "p95 ms": None, **scene},
    )


def of_sockets(address: str, pid: int, clock: Clock, seconds: float, count: int) -> dict[str, Any]:
    """Row of `count` viewers that read all that the monitor reads; its updates are those of the slowest one."""
    wanted = json.dumps({"watch": [FLOOR], "scans": [FLOOR], "postures": [FLOOR]})
    received, ended = [0] * count, threading.Event()

    def view(number: int) -> None:
        origin = {"Origin": address.rstrip("/")}
        connection: Any = connect(f"ws{address.removeprefix('http')}live", additional_headers=origin, max_size=None)
        with connection as socket:
            socket.send(wanted)
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    received[number] += isinstance(socket.recv(1.0), bytes)

    with ThreadPoolExecutor(count) as pool:
        viewers = [pool.submit(view, number) for number in range(count)]
        try:
            time.sleep(SETTLE_S / 2)
            before = list(received)
            row = measured(clock, pid, seconds)
            slowest = min(now - then for now, then in zip(received, before, strict=True)) / seconds
        finally:
            ended.set()
        for viewer in viewers:
            viewer.result()
    return {"viewers": f"{count} sockets", "updates/s": slowest, "p95 ms": None, **row}


def measure(seconds: float = 20.0, robots: int = 50, viewers: int = 8) -> bool:
    browser = chromium()
    if browser is None:
        PROGRESS.print("Chromium is missing: only viewers without a browser are measured")
    with folder_of_bench() as folder, crowded_console(folder, robots) as (address, pid, clock):
        time.sleep(SETTLE_S)
        rows: list[dict[str, Any]] = [
            {"viewers": "none", "updates/s": None, "p95 ms": None, **measured(clock, pid, seconds)}
        ]
        sockets = of_sockets(address, pid, clock, seconds, viewers)
        rows.append(sockets)
        marks = [
            at_most(f"console with {viewers} viewers, share of a core", sockets["console cores"], 0.25),
            at_least("pace beside that without viewers", sockets["pace"] / rows[0]["pace"], 0.98),
        ]
        if browser:
            monitor, scene = in_browser(address, pid, clock, seconds, browser)
            rows += [monitor, scene]
            marks += [
                at_least("updates of the monitor each second", monitor["updates/s"], 20.0),
                at_most("from the simulation to the picture, p95 in ms", monitor["p95 ms"], 150.0),
                at_most("console with one monitor, share of a core", monitor["console cores"], 0.15),
                at_least("pictures of the 3D page each second, 1000 x 650", scene["updates/s"], 15.0),
            ]
    picture = bars({row["viewers"]: row["console cores"] for row in rows}, "share of a core")
    return summarize(NAME, f"The console beside {robots} robots", rows, marks, picture)


if __name__ == "__main__":
    run(measure, seconds="of each measurement", robots="on one floor", viewers="without a browser")
