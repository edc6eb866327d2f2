"""Recovery times after kill -9 of clients, sensor servers and the simulation server.

    python -m bench.simulation.chaos --rounds 20

Three client processes with driving robots, two virtual sensor servers. Each round kills one client and one sensor
server, and then the simulation server right after it has accepted a grip, a ride and a robot."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from bench import RESULTS
from robocorba.testing.report import PROGRESS, at_most, quantile, summarize
from robocorba.testing.simulation import (
    CLIENT_SPEED,
    CLIENTS,
    LOST_S,
    RELEASE_LIMIT_S,
    ROBOTS_EACH,
    STOP_S,
    Chaos,
    Outcome,
    simulation,
)

NAME = "simulation_chaos"
#: Titles of the measurements, by the member of Outcome.
TIMES = {
    "stop_s": "dead client: its robots are stopped, s",
    "free_s": "dead client: names, places and slots are free, s",
    "sensor_s": "dead sensor server: it serves again, s",
    "scan_s": "dead sensor server: longest scan of the others, s",
    "back_s": "dead server: first answer, s",
    "lost_m": "dead server: robots were set back, m",
}
LIMITS = {"stop_s": STOP_S, "free_s": RELEASE_LIMIT_S}


def row(member: str, outcomes: list[Outcome]) -> dict[str, Any]:
    values = [getattr(outcome, member) for outcome in outcomes]
    spread = {"median": quantile(values, 0.5), "least": min(values), "most": max(values)}
    return {"after a kill": TIMES[member], "rounds": len(values), **spread}


def main() -> int:
    """Exit code: 0 if no round had a fault and every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=20, help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="for the times of the kills (default: %(default)s)")
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        simulation(Path(folder), sensors=2) as place,
        contextlib.closing(Chaos(place, options.seed)) as chaos,
    ):
        for number in range(1, options.rounds + 1):
            with PROGRESS.status(f"round {number} of {options.rounds}"):
                outcomes.append(chaos.round())
    faults = [f"MISSED in round {n}: {fault}" for n, outcome in enumerate(outcomes, 1) for fault in outcome.faults]
    if faults:
        print("\n".join(faults))
    marks = [
        *(
            at_most(TIMES[member], max(getattr(one, member) for one in outcomes), most)
            for member, most in LIMITS.items()
        ),
        at_most("rounds with a fault", sum(bool(one.faults) for one in outcomes), 0),
    ]
    title = (
        f"kills of a client, a sensor server and the server: {CLIENTS} clients with {ROBOTS_EACH} robots each at "
        f"{CLIENT_SPEED:g} m/s; poses of {LOST_S:g} s may be lost"
    )
    is_reached = summarize(
        RESULTS / NAME, title, [row(member, outcomes) for member in TIMES], marks, lambda axes: _draw(axes, outcomes)
    )
    return 0 if is_reached else 1


def _draw(axes: Axes, outcomes: list[Outcome]) -> None:
    for member in ("stop_s", "free_s", "sensor_s", "back_s"):
        ordered = sorted(getattr(outcome, member) for outcome in outcomes)
        axes.plot(ordered, [(i + 1) / len(ordered) for i in range(len(ordered))], marker=".", label=TIMES[member])
    axes.set(xlabel="s after the kill", ylabel="share of rounds")
    axes.legend()


if __name__ == "__main__":
    sys.exit(main())
