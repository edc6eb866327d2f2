"""`robocorba up` until `ready`: time, and CPU time of all its processes, beside those of an earlier commit.

    python -m bench.starts.ready [--rounds 7] [--base COMMIT]
    python -m bench.starts.ready --empty [--rounds 1]

The versions alternate. Compiled kernels are in the cache; with --empty each start has an empty one, as on a new
machine. `--base ""` measures this checkout alone."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench.common.harness import progress, run
from bench.starts.systems import BASE, OURS, Version, load, median, ratio, system, versions
from testkit.report import at_most, summarize

#: Required values: time of a warm start [s]; ratios to the base of its CPU time, and of the first start's time.
MAX_S, MAX_CPU_RATIO, MAX_FIRST_RATIO = 2.5, 0.5, 0.6
#: Time after `ready` whose CPU time is measured as well [s]: work that was put off counts too.
AFTER_S = 5.0


class Start(NamedTuple):
    """A start: time and CPU time until `ready`, CPU time of AFTER_S after it [s], and the load before."""

    wall_s: float
    cpu_s: float
    after_s: float
    load: float


def start(version: Version, state: Path, **environment: str) -> Start:
    load_before, began = load(), time.monotonic()
    with system(version, state, **environment) as up:
        wall_s, cpu_s = time.monotonic() - began, up.cpu_s()
        time.sleep(AFTER_S)
        return Start(wall_s, cpu_s, up.cpu_s() - cpu_s, load_before)


def starts(rounds: int, base: str, empty: bool, folder: Path) -> dict[str, list[Start]]:
    both = versions(base)
    if not empty:
        for version in both:
            start(version, folder / version.name)  # a new state; its kernels may not be compiled yet
    found: dict[str, list[Start]] = {version.name: [] for version in both}
    for number in progress(range(rounds), "starts of `robocorba up`"):
        for version in both if number % 2 else reversed(both):
            name = f"{version.name}-{number}" if empty else version.name
            environment = {"XDG_CACHE_HOME": str(folder / f"{name}-cache")} if empty else {}
            found[version.name].append(start(version, folder / name, **environment))
    return found


def row(version: str, found: list[Start]) -> dict[str, Any]:
    return {
        "version": version,
        "starts": len(found),
        "ready after, s": median([one.wall_s for one in found]),
        "quickest": min(one.wall_s for one in found),
        "slowest": max(one.wall_s for one in found),
        "CPU until then, s": median([one.cpu_s for one in found]),
        f"CPU of the next {AFTER_S:g} s": median([one.after_s for one in found]),
        "load": median([one.load for one in found]),
    }


def measure(rounds: int = 0, base: str = BASE, empty: bool = False) -> bool:
    rounds = rounds or (1 if empty else 7)
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as folder:
        found = starts(rounds, base, empty, Path(folder))
    wall_ratio = ratio(found, lambda starts: median([one.wall_s for one in starts]))
    cpu_ratio = ratio(found, lambda starts: median([one.cpu_s for one in starts]))
    marks = []
    if not empty:
        marks.append(at_most("ready after, median, s", median([one.wall_s for one in found[OURS]]), MAX_S))
    if wall_ratio and cpu_ratio:
        marks.append(
            at_most("first start by that of the base", wall_ratio, MAX_FIRST_RATIO)
            if empty
            else at_most("CPU until ready by that of the base", cpu_ratio, MAX_CPU_RATIO)
        )

    def draw(axes: Axes) -> None:
        for number, values in enumerate(found.values()):
            axes.plot([one.wall_s for one in values], [number] * len(values), "|b", markersize=20)
            axes.plot([one.cpu_s for one in values], [number] * len(values), ".r")
        axes.set(xlabel="s until ready (bars), CPU time until then (dots)", xlim=(0, None))
        axes.set_yticks(range(len(found)), list(found))

    name, title = ("starts_empty", "with no kernels") if empty else ("starts_ready", "with compiled kernels")
    rows = [row(*one) for one in found.items()]
    return summarize(name, f"`robocorba up` {title}", rows, marks, draw, wall_ratio=wall_ratio, cpu_ratio=cpu_ratio)


if __name__ == "__main__":
    run(
        measure,
        rounds="starts of each version, 0: 7, or 1 if empty",
        base="commit to compare with, empty for none",
        empty="without compiled kernels",
    )
