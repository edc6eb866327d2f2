"""The paper's experiment: python -m bench.events.network [--quick]"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.harness import NotMeasured, progress, run
from bench.events.network.experiment import FULL, QUICK, SILENCE_S, conduct, experiment, split_cores
from bench.events.network.networks import Network
from bench.events.network.report import write_report

ECHOES = 200


def main(quick: bool = False) -> bool:
    """Raises NotMeasured without network namespaces."""
    plan = QUICK if quick else FULL
    leaders_core, cores = split_cores()
    os.sched_setaffinity(0, cores)  # only the leader and its load run on the leader's core
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as folder:
        try:
            network = Network(Path(folder), cores)
        except OSError as error:
            raise NotMeasured(f"network namespaces are not available ({error}); run it as root") from None
        with network:
            about: dict[str, Any] = {
                "network": "network namespaces, packets delayed by a router process on TUN devices",
                "router has real-time priority": network.router_has_priority,
                "round trip without ORB, us": {f"{us / 1e3:g} ms": round_trips(network, us) for us in plan.delays_us},
                "leader's core": leaders_core,
                "other cores": cores,
            }
            with experiment(network, leaders_core) as running:
                before = network.counts(delay_us=0)
                time.sleep(SILENCE_S)
                idle = network.counts().since(before)
                about["while nobody speaks"] = f"{idle.packets} packets, {idle.bytes} bytes in {SILENCE_S:g} s"
                outcomes = list(progress(conduct(running, plan), "runs", plan.total))
    about["took, s"] = round(time.monotonic() - began, 1)
    return write_report(outcomes, about)


def round_trips(network: Network, delay_us: int) -> dict[str, float]:
    """Median and p95 of round trips [us]."""
    network.counts(delay_us=delay_us)
    p50, p95 = np.quantile(network.round_trips_us(ECHOES), (0.5, 0.95))
    return {"p50": round(float(p50), 1), "p95": round(float(p95), 1)}


if __name__ == "__main__":
    run(main, quick="2 delays, 4 loads, 4 runs each: about two minutes")
