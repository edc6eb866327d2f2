"""One of the processes that compile all kernels: python -m robocorba.system.supervision.compile_worker FOLDER

Each does the steps that no other one has taken yet, by files in FOLDER, which is empty at first. It waits for what
another one is compiling. It prints `ready` when it begins, and for each kernel that it has compiled a line with
its name and the time that this took without its callees [s].
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core import event

from robocorba.missions import carry_planning
from robocorba.planning import warm_up as planning
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.simulation import omni_database, physics
from robocorba.simulation.sensing import virtual_sensor
from robocorba.system import kernel_cache

#: All kernels, in the order in which steps are taken: the largest first, and what needs the others last. The second
#: one has no kernel in common with the first one, which would otherwise begin with waiting.
STEPS: dict[str, Callable[[], object]] = {
    "drives": planning.drives,
    "inverse kinematics": InverseKinematics,
    "shortest path": planning.shortest_path,
    "mesh": planning.mesh,
    "carry": carry_planning.warm_up,
    "sensors": virtual_sensor.warm_up,
    "connections": planning.connections,
    "physics": physics.warm_up,
    "floor state": omni_database.warm_up,
    "all queries": planning.all_queries,
}


class Listener(event.Listener):
    """Prints what is compiled. What a kernel uses of numba counts as its own."""

    def __init__(self) -> None:
        #: What is being compiled, the outermost first: since when, and the time of its callees [s].
        self._open: list[tuple[float, list[float]]] = []

    def on_start(self, event: Any) -> None:
        if _is_kernel(event):
            self._open.append((time.process_time(), []))

    def on_end(self, event: Any) -> None:
        if not _is_kernel(event):
            return
        began, callees = self._open.pop()
        seconds = time.process_time() - began
        if self._open:
            self._open[-1][1].append(seconds)
        print(event.data["dispatcher"]._cache.name, round(seconds - sum(callees), 3), flush=True)


def _is_kernel(event: Any) -> bool:
    return isinstance(event.data["dispatcher"]._cache, kernel_cache.KernelCache)


def main(folder: str) -> None:
    kernel_cache.shared_work = work = kernel_cache.SharedWork(Path(folder))
    gc.set_threshold(1_000_000)  # with Python's 700 the collector takes a fifth of the time
    print("ready", flush=True)
    with event.install_listener("numba:compile", Listener()):
        for name, step in STEPS.items():
            if work.take(name):
                step()


if __name__ == "__main__":
    main(sys.argv[1])
