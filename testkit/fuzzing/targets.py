"""The objects of all interfaces of a running system, and examples of arguments."""

from __future__ import annotations

from robocorba.stubs import RoboCorba
from testkit.fuzzing import event_targets, map_targets, robot_targets, simulation_targets
from testkit.fuzzing.calls import Target
from testkit.fuzzing.fuzzed_system import FuzzedSystem

#: Interfaces that clients implement, not servers of this system; adaptors are for agents in other processes.
OF_CLIENTS = [RoboCorba.EventConsumer, RoboCorba.IdempotentEventConsumer]
OF_CLIENTS += [RoboCorba.RobotAdaptor, RoboCorba.SensingAdaptor]
#: Those whose references servers keep for themselves, and those that need --guarded or clients behind NAT.
OUT_OF_REACH = (RoboCorba.StopTarget, RoboCorba.NameRegistry, RoboCorba.CallbackRoute)


def targets(system: FuzzedSystem) -> list[Target]:
    """One for each interface, or several where their objects differ."""
    return [
        *map_targets.targets(system),
        *simulation_targets.targets(system),
        *event_targets.targets(system),
        *robot_targets.of_agents(system),
        *robot_targets.of_units(system),
    ]
