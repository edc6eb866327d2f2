"""The console beside 50 robots, 8 with lasers and arms: updates, delay and cost in a browser and for 8 viewers.

python -m bench.console.viewers [--seconds S] [--robots N] [--viewers N]

It needs Chromium, which draws without a graphics card. The delay is from the step of
the simulation to the picture."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from websockets.sync.client import connect

from bench.common.harness import run, skip
from bench.console.crowd import FLOOR, Crowd, crowded_system
from robocorba.system.names import CONSOLE
from testkit.browser import chromium, headless
from testkit.report import at_least, at_most, quantile, summarize

#: Time for a page to draw at its final rate before the measurement [s].
SETTLE_S = 6.0
MONITOR_SIZE, SCENE_SIZE = {"width": 1366, "height": 768}, {"width": 1000, "height": 737}

#: Notes the browser's time [ms since 1970] and the simulated time [s] of each update, once it is drawn.
_WATCH = """async floor => { const { live } = await import("/static/live.js"); window.drawn = []; let last = -1;
    live.listen((kind, name) => kind === "floor" && name === floor && requestAnimationFrame(() => setTimeout(() => {
        const time = live.floors.get(floor).time;
        if (time !== last) { last = time; window.drawn.push([Date.now(), time]); } }, 0))); }"""
_PICTURES = "() => document.querySelector('.console-scene canvas').sceneView.pictures"


def in_browser(address: str, pid: int, crowd: Crowd, seconds: float, browser: str) -> tuple[dict[str, Any], ...]:
    """Rows of the monitor and of the 3D page."""
    with headless(browser) as started:
        page = started.new_page(viewport=MONITOR_SIZE)  # type: ignore[arg-type]
        page.set_default_timeout(120e3)
        page.goto(address)
        page.wait_for_timeout(SETTLE_S * 1e3)
        page.evaluate(_WATCH, FLOOR)
        monitor = crowd.measured(seconds, pid)
        drawn = page.evaluate("() => window.drawn")
        seen_ms, simulated = np.array(drawn).reshape(-1, 2).T
        delays_ms = (seen_ms - 1e3 * crowd.at(simulated)).tolist() or [float("nan")]
        page.set_viewport_size(SCENE_SIZE)  # type: ignore[arg-type]
        page.goto(f"{address}3d")
        page.wait_for_timeout(2 * SETTLE_S * 1e3)
        before, began = page.evaluate(_PICTURES), time.monotonic()
        scene = crowd.measured(seconds, pid)
        pictures = (page.evaluate(_PICTURES) - before) / (time.monotonic() - began)
    return (
        {"viewers": "monitor", "updates/s": len(drawn) / seconds, "p95 ms": quantile(delays_ms, 0.95), **monitor},
        {"viewers": "3D", "updates/s": pictures, **scene},
    )


def of_sockets(address: str, pid: int, crowd: Crowd, seconds: float, count: int) -> dict[str, Any]:
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
            row = crowd.measured(seconds, pid)
            slowest = min(now - then for now, then in zip(received, before, strict=True)) / seconds
        finally:
            ended.set()
        for viewer in viewers:
            viewer.result()
    return {"viewers": f"{count} sockets", "updates/s": slowest, **row}


def measure(seconds: float = 10.0, robots: int = 50, viewers: int = 8) -> bool:
    browser = chromium()
    if browser is None:
        skip("pages in a browser", "Chromium is missing")
    with crowded_system(robots, "--console", "--console-port", "0") as crowd:
        address, pid = crowd.place.running.record().console_address, crowd.place.running.pid(CONSOLE)
        time.sleep(SETTLE_S)
        nobody: dict[str, Any] = {"viewers": "none", **crowd.measured(seconds, pid)}
        sockets = of_sockets(address, pid, crowd, seconds, viewers)
        rows = [nobody, sockets]
        marks = [
            at_most(f"console with {viewers} viewers, share of a core", sockets["cores"], 0.25),
            at_least("pace beside that without viewers", sockets["pace"] / nobody["pace"], 0.98),
        ]
        if browser:
            monitor, scene = in_browser(address, pid, crowd, seconds, browser)
            rows += [monitor, scene]
            marks += [
                at_least("updates of the monitor each second", monitor["updates/s"], 20.0),
                at_most("from the simulation to the picture, p95 in ms", monitor["p95 ms"], 150.0),
                at_most("console with one monitor, share of a core", monitor["cores"], 0.15),
                at_least("pictures of the 3D page each second, 1000 x 650", scene["updates/s"], 15.0),
            ]
    return summarize("console_viewers", f"The console beside {robots} robots", rows, marks)


if __name__ == "__main__":
    run(measure, seconds="of each measurement", robots="on one floor", viewers="without a browser")
