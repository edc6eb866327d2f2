"""getPath over IIOP on the sample buildings, compared to a null call to the same object and to an answer of the same
size without any planning. The three alternate in the same run."""

from __future__ import annotations

import contextlib
import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omniORB import CORBA

from bench.common.harness import run
from robocorba.clients.robot_processes import servers
from robocorba.map_editor.samples import SAMPLES, load_sample, sample_path
from robocorba.orb.orb import Orb
from robocorba.planning.request import SMARTPAL_RADIUS_M
from robocorba.stubs import RoboCorba
from robocorba.system.claimed_ports import claimed_ports
from testkit.generated_buildings import random_places
from testkit.json_process import Process, checkout_command
from testkit.processes import eventually
from testkit.report import distribution, quantile, summarize, timed_ms


def main(calls: int = 2200, rounds: int = 5) -> bool:
    """There are no marks: the results are judged by their ratios."""
    for name in SAMPLES:
        measure(name, calls, rounds)
    return True


def measure(name: str, calls: int, rounds: int) -> None:
    """Time the three calls on one sample building, in rounds of queries at random places."""
    points = [
        RoboCorba.Point(*place) for place in random_places(load_sample(name), SMARTPAL_RADIUS_M, 2 * calls, seed=7)
    ]
    pairs = list(zip(points[::2], points[1::2], strict=True))
    rows = []
    with (
        tempfile.TemporaryDirectory() as folder,
        servers(Path(folder), "--building", str(sample_path(name))) as naming,
        Orb(naming) as orb,
    ):
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        pairs = [pair for pair in pairs if _is_reachable(planner, *pair)]
        length = round(statistics.mean(len(planner.getPath(*pair)) for pair in pairs))
        with claimed_ports() as port, canned(Path(folder), port, length) as canned_planner:
            for round_ in range(1, rounds + 1):
                us: dict[str, list[float]] = {"null call": [], "canned answer": [], "getPath": []}
                for pair in pairs:  # alternating, so that a busy moment of the machine affects all three
                    us["null call"].append(1e3 * timed_ms(planner._non_existent)[1])
                    us["canned answer"].append(1e3 * timed_ms(canned_planner.getPath, *pair)[1])
                    us["getPath"].append(1e3 * timed_ms(planner.getPath, *pair)[1])
                null, answer, path = map(statistics.median, us.values())
                rows.append(
                    {
                        "round": round_,
                        "null call, us": null,
                        f"canned answer of {length} points, us": answer,
                        "getPath, us": path,
                        "getPath p99, us": quantile(us["getPath"], 0.99),
                        "getPath / null call": path / null,
                        "getPath / canned answer": path / answer,
                    }
                )
    ratio = statistics.median(row["getPath / null call"] for row in rows)
    title = f"getPath over IIOP, {name}, medians of {len(pairs)} random queries: {ratio:.2f} null calls"
    summarize(f"get_path_{name}", title, rows, [], distribution(us, "us"))


@contextlib.contextmanager
def canned(folder: Path, port: int, points: int) -> Iterator[Any]:
    """The object of bench.planning.canned_answer in its own process, at a free port."""
    endpoint = f"127.0.0.1:{port}"
    orb = CORBA.ORB_init([], CORBA.ORB_ID)
    planner = orb.string_to_object(f"corbaloc:iiop:{endpoint}/PathPlanner")._unchecked_narrow(RoboCorba.PathPlanner)

    def answers() -> bool:
        try:
            return not planner._non_existent()
        except CORBA.TRANSIENT:
            return False

    with Process(checkout_command("bench.planning.canned_answer", endpoint, str(points)), folder / "canned.log"):
        eventually(answers, 20.0, "the canned answer")
        yield planner


def _is_reachable(planner: Any, start: Any, goal: Any) -> bool:
    """Whether there is a path; a few random places are enclosed by furniture."""
    try:
        planner.getPath(start, goal)
    except RoboCorba.NoPath:
        return False
    return True


if __name__ == "__main__":
    run(main, calls="queries in a round")
