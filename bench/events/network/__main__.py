"""The paper's experiment: python -m bench.events.network [--network paper] [--leader all] [--quick]"""

from __future__ import annotations

import os
import time
from typing import Any

from bench.common.harness import NotMeasured, folder_of_bench, progress, run
from bench.events.network.experiment import conduct, plan_of, split_cores
from bench.events.network.networks import Network
from bench.events.network.report import write_report
from bench.events.network.robot import LEADERS, PUSHED
from testkit.report import others_cpu_s


def main(network: str = "delays", leader: str = PUSHED, quick: bool = False) -> bool:
    """Raises NotMeasured without network namespaces, and if the measurement is invalid."""
    plan = plan_of(network, leader, quick)
    leaders_core, cores = split_cores()
    os.sched_setaffinity(0, cores)  # only the leader and its load run on the leader's core
    began, others_s = time.monotonic(), others_cpu_s()
    with folder_of_bench() as folder:
        try:
            hosts = Network(folder, cores)
        except OSError as error:
            raise NotMeasured(
                f"latencies, their ratio, traffic: network namespaces are not available ({error}); run it as root"
            ) from None
        with hosts:
            about: dict[str, Any] = {
                "network": "network namespaces; a process carries all packets (testkit/router.py)",
                "it has real-time priority": hosts.router_has_priority,
                "leader's core": leaders_core,
                "other cores": cores,
            }
            outcomes = list(progress(conduct(hosts, leaders_core, plan), "runs", plan.total))
    took_s = time.monotonic() - began
    about |= {"took, s": round(took_s, 1), "s a run": round(took_s / plan.total, 2)}
    return write_report(outcomes, (others_cpu_s() - others_s) / took_s, about)


if __name__ == "__main__":
    run(
        main,
        network="paper|delays",
        leader="|".join(("all", *LEADERS)),
        quick="few loads, three runs each: about two minutes",
    )
