"""The paper's experiment: python -m bench.events.network [--quick]"""

from __future__ import annotations

import os
import time
from typing import Any

from bench.common.harness import NotMeasured, folder_of_bench, progress, run
from bench.events.network.experiment import FULL, QUICK, SILENCE_S, conduct, experiment, split_cores
from bench.events.network.networks import Network
from bench.events.network.report import write_report


def main(quick: bool = False) -> bool:
    """Raises NotMeasured without network namespaces."""
    plan = QUICK if quick else FULL
    leaders_core, cores = split_cores()
    os.sched_setaffinity(0, cores)  # only the leader and its load run on the leader's core
    began = time.monotonic()
    with folder_of_bench() as folder:
        try:
            network = Network(folder, cores)
        except OSError as error:
            raise NotMeasured(f"network namespaces are not available ({error}); run it as root") from None
        with network:
            about: dict[str, Any] = {
                "network": "network namespaces, packets delayed by a router process on TUN devices",
                "router has real-time priority": network.router_has_priority,
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


if __name__ == "__main__":
    run(main, quick="2 delays, 4 loads, 4 runs each: about two minutes")
