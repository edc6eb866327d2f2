"""The process that compiles all kernels: python -m robocorba.system.supervision.compile_worker

It prints the name of each kernel that it has compiled."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

from numba.core import event

from robocorba.map_editor.model import Building
from robocorba.missions import carry_planning
from robocorba.planning.planner import PathPlanner
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.simulation import omni_database, physics
from robocorba.simulation.sensing import virtual_sensor

#: What compiles or loads all kernels.
STEPS: tuple[Callable[[], object], ...] = (
    PathPlanner(Building("none")).warm_up,
    InverseKinematics,
    carry_planning.warm_up,
    virtual_sensor.warm_up,
    physics.warm_up,
    omni_database.warm_up,
)


class Listener(event.Listener):
    """Prints what is compiled."""

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        print(f"{function.__module__}.{function.__qualname__}", flush=True)


def main() -> None:
    gc.set_threshold(1_000_000)  # looking for garbage after 700 new objects, as by default, takes a fifth of the time
    with event.install_listener("numba:compile", Listener()):
        for step in STEPS:
            step()


if __name__ == "__main__":
    main()
