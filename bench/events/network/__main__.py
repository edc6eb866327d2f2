"""The paper's experiment: python -m bench.events.network [--quick] [--relay]"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from types import FrameType
from typing import Any

from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from bench.common.processes import ProcessFailed
from bench.events.network import outcome
from bench.events.network.experiment import (
    FULL,
    QUICK,
    SILENCE_S,
    Experiment,
    Outcome,
    Plan,
    conduct,
    experiment,
    split_cores,
)
from bench.events.network.networks import Network, counts, describe_round_trips, networks, round_trips_us
from robocorba.testing.report import PROGRESS

ECHOES = 200


def main(arguments: list[str] | None = None) -> int:
    """Exit code: 0 if every mark was reached, 1 if not or after a failure."""
    parser = argparse.ArgumentParser(prog="python -m bench.events.network", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="2 delays, 4 loads, 4 runs each: about two minutes")
    parser.add_argument(
        "--relay", action="store_true", help="use a relay on the loopback even if namespaces are available"
    )
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _stop)
    try:
        outcomes, about = measure(QUICK if given.quick else FULL, given.relay)
    except ProcessFailed as failure:
        print(f"bench: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("bench: stopped", file=sys.stderr)
        return 1
    return 0 if outcome.summarize(outcomes, about) else 1


def measure(plan: Plan, relay: bool = False) -> tuple[list[Outcome], dict[str, Any]]:
    """All runs of a plan, and a description of the measurement. Raises ProcessFailed."""
    leaders_core, cores = split_cores()
    os.sched_setaffinity(0, cores)  # only the leader and its load run on the leader's core
    began = time.monotonic()
    with (
        tempfile.TemporaryDirectory(prefix="robocorba-bench-") as folder,
        networks(Path(folder), cores, relay) as network,
    ):
        about: dict[str, Any] = {
            "network": network.how,
            "router has real-time priority": network.router_has_priority,
            "round trip without ORB, us": _round_trips(network, plan),
            "leader's core": leaders_core,
            "other cores": cores,
        }
        with experiment(network, Path(folder), leaders_core, cores) as running:
            idle = running.silence()
            about["while nobody speaks"] = (
                f"{sum(idle.packets)} {network.holds}, {sum(idle.bytes)} bytes in {SILENCE_S:g} s"
            )
            outcomes = _with_progress(running, plan)
    about["took, s"] = round(time.monotonic() - began, 1)
    return outcomes, about


def _round_trips(network: Network, plan: Plan) -> dict[str, dict[str, float]]:
    """Round-trip times, by delay in ms."""
    found = {}
    for delay_us in plan.delays_us:
        counts(network, delay_us=delay_us)
        found[f"{delay_us / 1e3:g} ms"] = describe_round_trips(round_trips_us(network, ECHOES))
    counts(network, delay_us=0)
    return found


def _with_progress(running: Experiment, plan: Plan) -> list[Outcome]:
    outcomes = []
    columns = (*Progress.get_default_columns()[:-1], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=PROGRESS) as progress:
        task = progress.add_task("runs", total=plan.total)
        for one in conduct(running, plan):
            outcomes.append(one)
            progress.update(task, advance=1, description=f"{one.delay_us / 1e3:g} ms, {one.load:.0%}")
    return outcomes


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
