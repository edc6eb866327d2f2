"""The objects of robots: agents, data pools, their supervisor, and the units of an actual robot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from typing import Any

from omniORB import CORBA

from robocorba.stubs import RoboCorba, YeRTUnitMobility, _GlobalIDL
from testkit.fuzzing.calls import Target
from testkit.fuzzing.examples import ICONS, MISSIONS, OTHER, ROBOT, always, example, with_members
from testkit.fuzzing.fuzzed_system import FuzzedSystem


def end_processes(system: FuzzedSystem, name: str, result: Any) -> None:
    """End robots that were started."""
    for one in system.supervisor.processes() if name == "startRobot" else ():
        if one.name.startswith("robot_") and one.name[6:] not in (ROBOT, OTHER):
            system.supervisor.endRobot(one.name[6:])


def no_faults(system: FuzzedSystem, name: str, result: Any) -> None:
    """Switch the faults of the stand-in off."""
    assert system.stand_in
    system.stand_in.faults.none()


def of_agents(system: FuzzedSystem) -> Iterator[Target]:
    """Those of robot clients, and the supervisor that starts them."""
    programs = [{"format": 1, "name": "p", "icons": [icon]} for icon in (*ICONS, *MISSIONS)]
    programs.append({"format": 1, "name": "all", "robot": "SmartPal", "icons": ICONS})
    documents = [example(json.dumps(program)) for program in programs]
    on_agent = {
        "loadProgram": documents,
        "checkProgram": documents,
        "startMission": [example("m", json.dumps(icon)) for icon in MISSIONS],
        "leadMission": [example("m", json.dumps(icon), 1) for icon in MISSIONS],
        "abortMission": [example("m")],
        "iconsFrom": [example(0)],
        "answer": [example(1, True)],
        "setSpeedCap": [example(0.5)],
        "drive": [example(RoboCorba.Velocity(0.05, 0.0, 0.1), 0.2)],
        "switchAdaptor": [example("simulated", [])],
        "run": [example(False)],
    }

    def reset(name: str, result: Any) -> None:
        if name in ("run", "startMission", "leadMission", "step", "resume", "drive"):
            system.agent.abort()
        if name == "stop":
            system.agent.resetStop()

    yield Target(RoboCorba.RobotAgent, lambda: system.agent, on_agent, reset)
    pool, sensors = system.agent._get_pool(), system.agent._get_sensors()
    on_pool = {"changes": [example(1)], "postures": [example(0.0)], "plan": [example("m")]}
    yield Target(RoboCorba.DataPool, always(pool), on_pool)
    yield Target(RoboCorba.RobotSensors, always(sensors), {"ranges": [example("laser")]})
    order = RoboCorba.RobotOrder("C", "simulated", [], "L1", True, 9.0, 3.0, 0.0, "a")
    on_supervisor = {
        "startRobot": [example(with_members(order, adaptor="none")), example(with_members(order, channel="none"))],
        "endRobot": [example("nobody")],
        "logLines": [example(name, 10) for name in ("simulation", "up", "events_a")],
    }
    yield Target(
        RoboCorba.Supervisor,
        lambda: system.supervisor,
        on_supervisor,
        partial(end_processes, system),
        unseen=frozenset({"endRobot"}),
    )


def of_units(system: FuzzedSystem) -> Iterator[Target]:
    """Those of the stand-in for an actual robot, if there is one."""
    if system.stand_in is None:
        return
    lost = {"": (CORBA.COMM_FAILURE,)}
    for name, interface in (
        ("Mobility", YeRTUnitMobility.mobility),
        ("MnpL", _GlobalIDL.ArmUnit),
        ("GripperL", _GlobalIDL.GripperUnit),
        ("GripperR", _GlobalIDL.GripperExtAxes),
        ("Lumbar", _GlobalIDL.LumbarUnit),
        ("Lumbar", _GlobalIDL.LumbaExtAxes),
    ):
        bound = "Mobility.Unit" if name == "Mobility" else name
        yield Target(interface, always(system.unit(bound, interface)))
    faults = {
        "alarm": [example("Mobility", 1, _GlobalIDL.FAULT, "a fault")],
        "stuck": [example("MnpL", True)],
        "lost": [example("MnpL", True)],
        "slowNetwork": [example(0.01)],
    }
    yield Target(
        RoboCorba.SmartPalFaults, always(system.stand_in.faults), faults, partial(no_faults, system), also=lost
    )
