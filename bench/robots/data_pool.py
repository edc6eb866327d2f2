"""Data pools in a building with many moving robots: age of their content, duration of a floor change, memory.

python -m bench.robots.data_pool [--seconds S] [--runs N] [--robots N]

The simulation server and the map editor are real processes. So are the pools: one process for each floor, and one whose
pool changes floors all the time.

The age of a pool's content is measured from the last request that the server answered with an older state to the
moment at which a reader reads the pool. So it is never too small, and at most the interval of these requests too
large."""

from __future__ import annotations

import argparse
import bisect
import contextlib
import itertools
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.processes import Process
from bench.robots.data_pool_client import LOOK_S
from bench.simulation.building import robots
from bench.simulation.robots_client import START_LIMIT_S, Clients
from robocorba.clients.robot_processes import servers
from robocorba.corba.orb import Orb
from robocorba.maps.samples import load_sample, sample_path
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, quantile, summarize

NAME = "data_pool"
SAMPLE, ROBOTS = "five-floors", 200
#: Processes and threads for the robots, and commands to each robot [1/s].
PROCESSES, THREADS, RATE = 2, 2, 4.0
#: Time for which robots drive before the measurement, and lead time of their start command [s].
WARM_UP_S, LEAD_S = 3.0, 0.5
#: Interval between requests for the server's time, and between floor changes [s].
ASK_S, CHANGE_S = 0.003, 0.1
MAX_LAG_MS, MAX_CHANGE_MS, MAX_SHARE, MAX_GROWTH, MIN_MOVING = 100.0, 200.0, 0.35, 1.1, 0.5
Stamps = list[tuple[float, float]]


@contextlib.contextmanager
def pools(naming: Address, folder: Path, name: str, floors: Sequence[str]) -> Iterator[tuple[Process, dict[str, Any]]]:
    """A process with a pool for each of these floors, and its answer once they are loaded."""
    command = (sys.executable, "-m", "bench.robots.data_pool_client", str(naming))
    with Process(command, folder / f"pool-{name}.log") as process:
        process.receive(START_LIMIT_S)
        yield process, process.ask({"do": "follow", "floors": list(floors)}, START_LIMIT_S)


def ask_time(server: Any, until: float) -> Stamps:
    """Times of requests for the server's time, and the answers."""
    stamps = []
    while (asked_at := time.monotonic()) < until:
        stamps.append((asked_at, float(server._get_state().time)))
        time.sleep(ASK_S)
    return stamps


def ages_ms(stamps: Stamps, looks: Sequence[Sequence[float]], every_s: float = LOOK_S) -> list[float]:
    """Greatest ages [ms] of what readers read at this interval, by the stamps of `ask_time`.

    A late reading counts for all readings that were due since the one before."""
    times = [simulated for _, simulated in stamps]
    found = []
    for (seen_at, simulated, _), (next_at, _, _) in itertools.pairwise(looks):
        before = max(0, bisect.bisect_left(times, simulated - 1e-6) - 1)  # the last request with an older state
        for due in range(max(1, round((next_at - seen_at) / every_s))):
            found.append((seen_at + due * every_s - stamps[before][0]) * 1e3)
    return found


def run(
    server: Any, clients: Clients, watchers: Sequence[Process], rider: Process, floors: Sequence[str], seconds: float
) -> dict[str, Any]:
    """Drive all robots, read the pools, and let one pool change floors."""
    begin = time.monotonic() + LEAD_S
    total_s = WARM_UP_S + seconds
    looked_from = begin + WARM_UP_S
    for watcher in watchers:
        watcher.send({"do": "look", "begin": looked_from, "seconds": seconds})
    rider.send({"do": "go", "floors": list(floors), "begin": looked_from, "seconds": seconds, "every_s": CHANGE_S})
    with ThreadPoolExecutor(1) as executor:
        driving = executor.submit(clients.all, "drive", begin=begin, seconds=total_s, rate=RATE, threads=THREADS)
        time.sleep(max(0.0, looked_from - 1.0 - time.monotonic()))
        began, simulated = time.monotonic(), server._get_state().time
        stamps = ask_time(server, looked_from + seconds)
        pace = (server._get_state().time - simulated) / (time.monotonic() - began)
        seen = [watcher.receive(seconds + START_LIMIT_S) for watcher in watchers]
        changes = rider.receive(seconds + START_LIMIT_S)["change"]
        driven = driving.result()
    return {
        "ages": [age for one in seen for age in ages_ms(stamps, one["looks"])],
        "says": [look[2] * 1e3 for one in seen for look in one["looks"]],
        "change": changes,
        "moving": statistics.mean(one["moving"] for one in seen),
        "cpu": statistics.mean(one["cpu"] for one in seen),
        "lost": driven["lost"],
        "pace": pace,
        "asked every": 1e3 * (stamps[-1][0] - stamps[0][0]) / len(stamps),
    }


def row_of(number: int, found: dict[str, Any]) -> dict[str, Any]:
    """The row of one run."""
    return {
        "run": str(number),
        "age ms": statistics.median(found["ages"]),
        "age p99": quantile(found["ages"], 0.99),
        "age worst": max(found["ages"]),
        "pool says p99": quantile(found["says"], 0.99),
        "server asked every ms": found["asked every"],
        "changes": len(found["change"]),
        "change ms": statistics.median(found["change"]),
        "change p99": quantile(found["change"], 0.99),
        "change worst": max(found["change"]),
        "moving": found["moving"],
        "lost": found["lost"],
        "pace": found["pace"],
        "cores of a pool": found["cpu"],
    }


def marks_of(rows: Sequence[dict[str, Any]]) -> list[Mark]:
    """Marks, by the medians of the runs."""

    def median(column: str) -> float:
        return statistics.median(row[column] for row in rows)

    return [
        at_most("age of what pools show, p99 ms", median("age p99"), MAX_LAG_MS),
        at_most("change of floors, p99 ms", median("change p99"), MAX_CHANGE_MS),
        at_least("share of robots that move", median("moving"), MIN_MOVING),
    ]


def memory_rows(
    naming: Address, folder: Path, floors: Sequence[str], rider: Process, changes: int
) -> list[dict[str, Any]]:
    """Memory of a pool of each floor, of pools of all floors in one process, and of a pool that has been on all
    floors."""
    rows = []
    cases = [([floor], f"on {floor}") for floor in floors] + [(list(floors), f"{len(floors)} pools, on all floors")]
    for number, (where, what) in enumerate(cases):
        with pools(naming, folder, f"memory-{number}", where) as (process, loaded):
            before, _ = loaded["uss"]
            found = process.ask({"do": "memory"}, START_LIMIT_S)
            rows.append(memory_row(what, found["bytes"], found["uss"] - before, found["uss"]))
    rider.ask({"do": "go_home", "floor": floors[0]}, START_LIMIT_S)
    found = rider.ask({"do": "memory"}, START_LIMIT_S)
    rows.append(memory_row(f"on {floors[0]}, after {changes} changes", found["bytes"], None, found["uss"]))
    return rows


def memory_row(what: str, held: int, growth: int | None, uss: int) -> dict[str, Any]:
    return {
        "pool": what,
        "KB held": held / 1024,
        "KB that the process grew": None if growth is None else growth / 1024,
        "MB of the process": uss / 1024**2,
    }


def memory_marks_of(rows: Sequence[dict[str, Any]]) -> list[Mark]:
    """A pool's memory is that of its floor, even after it has been on all floors."""
    *single, everything, traveller = (row["KB held"] for row in rows)
    return [
        at_most("bytes of the largest floor's pool, of those of all", max(single) / everything, MAX_SHARE),
        at_most("bytes after all changes, of those of a new pool", traveller / single[0], MAX_GROWTH),
    ]


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=5, help="default: %(default)s")
    parser.add_argument("--robots", type=int, default=ROBOTS, help="default: %(default)s")
    options = parser.parse_args()
    building = load_sample(SAMPLE)
    floors = list(building.floors)
    runs = []
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        naming = stack.enter_context(servers(folder / "state", "--building", str(sample_path(SAMPLE))))
        server = stack.enter_context(Orb(naming)).resolve("SimulationServer", RoboCorba.SimulationServer)
        clients = stack.enter_context(Clients(naming, PROCESSES, folder))
        clients.log_on(robots(building, 2 * options.robots), options.robots)
        rider, _ = stack.enter_context(pools(naming, folder, "rider", floors[:1]))
        with contextlib.ExitStack() as watching:
            watchers = [watching.enter_context(pools(naming, folder, floor, [floor]))[0] for floor in floors]
            for number in range(1, options.runs + 1):
                with PROGRESS.status(f"run {number} of {options.runs}"):
                    runs.append(run(server, clients, watchers, rider, floors, options.seconds))
        with PROGRESS.status("memory"):
            memory = memory_rows(naming, folder, floors, rider, sum(len(found["change"]) for found in runs))
    rows = [row_of(number, found) for number, found in enumerate(runs, 1)]
    title = f"{options.robots} robots that move on {len(floors)} floors, {len(floors) + 1} pools, {options.seconds:g} s"
    is_reached = summarize(RESULTS / NAME, title, rows, marks_of(rows), lambda axes: _draw(axes, runs))
    title = f"Data pools with {options.robots} robots on {len(floors)} floors"
    are_reached = summarize(
        RESULTS / f"{NAME}_memory", title, memory, memory_marks_of(memory), lambda axes: _draw_memory(axes, memory)
    )
    return 0 if is_reached and are_reached else 1


def _draw(axes: Axes, runs: Sequence[dict[str, Any]]) -> None:
    for what, label in (
        ("ages", "age of what a pool shows"),
        ("says", "age as the pool says"),
        ("change", "change of floors"),
    ):
        ordered = sorted(ms for found in runs for ms in found[what])
        axes.plot(ordered, [i / len(ordered) for i in range(len(ordered))], label=label)
    axes.set(xscale="log", xlabel="ms", ylabel="share below")
    axes.legend()


def _draw_memory(axes: Axes, rows: Sequence[dict[str, Any]]) -> None:
    axes.barh([row["pool"] for row in rows], [row["KB held"] for row in rows])
    axes.invert_yaxis()
    axes.set_xlabel("KB held")


if __name__ == "__main__":
    sys.exit(main())
