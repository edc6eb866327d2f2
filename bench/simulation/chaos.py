"""Recovery times after kill -9 of clients, sensor servers and the simulation server.

    python -m bench.simulation.chaos --rounds 10

Three client processes with driving robots, two virtual sensor servers. Each round kills one client and one sensor
server, and then the simulation server right after it has accepted a grip, a ride and a robot."""

from __future__ import annotations

import contextlib

from bench.common.harness import folder_of_bench, progress, run
from testkit.report import at_most, summarize, summary
from testkit.simulation import LOST_S, RELEASE_LIMIT_S, STOP_S, Chaos, simulation

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


def main(rounds: int = 10, seed: int = 1) -> bool:
    with (
        folder_of_bench() as folder,
        simulation(folder, sensors=2) as place,
        contextlib.closing(Chaos(place, seed)) as chaos,
    ):
        outcomes = [chaos.round() for _ in progress(range(rounds), "rounds")]
    print(*(f"round {number}: {fault}" for number, one in enumerate(outcomes, 1) for fault in one.faults), sep="\n")
    times = {title: [getattr(outcome, member) for outcome in outcomes] for member, title in TIMES.items()}
    rows = [{"after a kill": title, **summary(values, "median", worst="most")} for title, values in times.items()]
    marks = [at_most(TIMES[member], max(times[TIMES[member]]), most) for member, most in LIMITS.items()]
    marks.append(at_most("rounds with a fault", sum(bool(one.faults) for one in outcomes), 0))
    title = f"kills of a client, a sensor server and the server, {rounds} rounds; poses of {LOST_S:g} s may be lost"
    return summarize("simulation_chaos", title, rows, marks, times, "s after the kill; m")


if __name__ == "__main__":
    run(main, seed="for the times of the kills")
