"""The process that compiles all kernels: python -m robocorba.system.supervision.compile_worker

It and a copy of it do half of the steps each."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable

from robocorba.map_editor.model import Building
from robocorba.missions import carry_planning
from robocorba.planning import tangent_graph
from robocorba.planning.planner import PathPlanner
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.simulation import omni_database, physics
from robocorba.simulation.sensing import virtual_sensor
from robocorba.system.supervision.child import bind_to_parent

#: What compiles or loads all kernels. The halves take about as long, and have few kernels in common but those of free
#: space: the first half needs them last, when the second one has compiled them.
STEPS: tuple[tuple[Callable[[], object], ...], ...] = (
    (PathPlanner(Building("none")).warm_up, omni_database.warm_up),
    (tangent_graph.warm_up, InverseKinematics, carry_planning.warm_up, virtual_sensor.warm_up, physics.warm_up),
)


def main() -> None:
    gc.set_threshold(1_000_000)  # looking for garbage after 700 new objects, as by default, takes a fifth of the time
    this = os.getpid()
    child = os.fork()
    if not child:
        bind_to_parent(signal.SIGKILL)
        if os.getppid() != this:  # it has ended meanwhile
            return
    for step in STEPS[bool(child)]:
        step()
    if child and (status := os.waitpid(child, 0)[1]):
        sys.exit(f"its copy ended: exit code {os.waitstatus_to_exitcode(status)}")


if __name__ == "__main__":
    main()
