"""getPath over IIOP on the sample buildings, compared to a null call to the same object and to an answer of the same
size without any planning. The three alternate in the same run.
"""

from __future__ import annotations

import contextlib
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from omniORB import CORBA

from bench import RESULTS
from bench.common.places import random_places
from robocorba.backoff import Backoff
from robocorba.clients.robot_processes import servers
from robocorba.corba.orb import Orb
from robocorba.maps.samples import SAMPLES, load_sample, sample_path
from robocorba.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import ChildProcess
from robocorba.testing.report import quantile, summarize_samples

CALLS, ROUNDS = 2200, 5


def main() -> None:
    for name in SAMPLES:
        measure(name)


def measure(name: str) -> None:
    """Time the three calls on one sample building, in ROUNDS rounds of CALLS queries at random places."""
    places = random_places(load_sample(name), SMARTPAL_RADIUS_M, 2 * CALLS, seed=7)
    points = [RoboCorba.Point(*place) for place in places]
    pairs = list(zip(points[::2], points[1::2], strict=True))
    rows = []
    with (
        tempfile.TemporaryDirectory() as state,
        servers(Path(state), "--building", str(sample_path(name))) as naming,
        Orb(naming) as orb,
    ):
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        pairs = [pair for pair in pairs if _is_reachable(planner, *pair)]
        length = round(statistics.mean(len(planner.getPath(*pair)) for pair in pairs))
        with canned(length) as canned_planner:
            for round_ in range(1, ROUNDS + 1):
                null: list[float] = []
                canned_: list[float] = []
                path: list[float] = []
                for start, goal in pairs:  # alternating, so that a busy moment of the machine affects all three
                    null.append(_timed(planner._non_existent))
                    canned_.append(_timed(canned_planner.getPath, start, goal))
                    path.append(_timed(planner.getPath, start, goal))
                medians = [statistics.median(values) for values in (null, canned_, path)]
                rows.append(
                    {
                        "round": round_,
                        "null call, us": medians[0],
                        f"canned answer of {length} points, us": medians[1],
                        "getPath, us": medians[2],
                        "getPath p99, us": quantile(path, 0.99),
                        "getPath / null call": medians[2] / medians[0],
                        "getPath / canned answer": medians[2] / medians[1],
                    }
                )
    ratio = statistics.median(row["getPath / null call"] for row in rows)
    title = f"getPath over IIOP, {name}, medians of {len(pairs)} random queries: {ratio:.2f} null calls"
    summarize_samples(
        RESULTS / f"get_path_{name}", title, rows, {"null call": null, "canned answer": canned_, "getPath": path}, "us"
    )


@contextlib.contextmanager
def canned(points: int) -> Iterator[Any]:
    """The object of bench.planning.canned_answer in its own process."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"127.0.0.1:{probe.getsockname()[1]}"
    command = (sys.executable, "-m", "bench.planning.canned_answer", endpoint, str(points))
    with ChildProcess(*command, stderr=subprocess.DEVNULL):
        orb = CORBA.ORB_init([], CORBA.ORB_ID)
        planner = orb.string_to_object(f"corbaloc:iiop:{endpoint}/PathPlanner")._unchecked_narrow(RoboCorba.PathPlanner)
        Backoff(0.1, 0.1).call(planner._non_existent, 20.0, CORBA.TRANSIENT)
        yield planner


def _is_reachable(planner: Any, start: Any, goal: Any) -> bool:
    """Whether there is a path; a few random places are enclosed by furniture."""
    try:
        planner.getPath(start, goal)
    except RoboCorba.NoPath:
        return False
    return True


def _timed(call: Callable[..., object], *arguments: object) -> float:
    began = time.perf_counter()
    call(*arguments)
    return (time.perf_counter() - began) * 1e6


if __name__ == "__main__":
    main()
