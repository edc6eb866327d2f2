"""The console and the supervisor of a running system: robots as its processes, killed and restarted."""

from __future__ import annotations

import functools
import json
import os
import signal
import stat
import time
import urllib.request
from pathlib import Path
from typing import Any

import psutil
import pytest

from robocorba.errors.services import NotReachable, ProcessExists, UnknownProcess
from robocorba.errors.simulation import InvalidChoice
from robocorba.orb.orb import Orb
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.names import SUPERVISOR
from robocorba.system.processes import ProcessPhase, ProcessState, RobotOrder
from testkit.processes import ROBOCORBA, Running, eventually, is_running, refusal, running_system

pytest.importorskip("nicegui", reason="the console's packages are not installed")
pytestmark = pytest.mark.system

#: Timeout for a process to get ready on a busy machine [s].
START_S = 90.0


def call(system: Running, operation: str, /, **arguments: Any) -> Any:
    """The answer of an operation, or its error as a text."""
    request = urllib.request.Request(
        f"{system.record().console_address}call/{operation}", json.dumps(arguments).encode()
    )
    request.add_header("Content-Type", "application/json")
    with urllib.request.urlopen(request, timeout=60.0) as answer:
        content = json.load(answer)
    return content["error"] if "error" in content else content["answer"]


def past(system: Running, at: float) -> bytes:
    """The frame of the lowest floor at a POSIX time [s]."""
    with urllib.request.urlopen(f"{system.record().console_address}past?floor=L1&at={at}", timeout=60.0) as answer:
        return bytes(answer.read())


def state_of(supervisor: RemoteSupervisor, name: str) -> ProcessState | None:
    return next((state for state in supervisor.processes() if state.name == name), None)


def wait_for(supervisor: RemoteSupervisor, name: str, phase: ProcessPhase) -> ProcessState:
    """Wait until a process is in a phase."""

    def state() -> ProcessState | None:
        found = state_of(supervisor, name)
        return found if found and found.phase is phase else None

    found: ProcessState = eventually(state, START_S, f"{name} is {phase}")
    return found


def test_the_console_is_a_process_of_the_system(tmp_path: Path) -> None:
    with running_system(tmp_path, "--console", "--console-port", "0") as (system, launch), Orb(system.naming) as orb:
        supervisor = RemoteSupervisor(orb, system.state / SUPERVISOR)
        check_console(system, supervisor)
        check_refusals(supervisor)
        check_robots(system, supervisor)
        check_kill(system, supervisor)
        port = system.record().console_address.rstrip("/").rpartition(":")[2]
        with claimed_ports() as naming:
            options = ("--state", "other", "--naming-port", str(naming), "--console", "--console-port", port)
            said = refusal(launch(ROBOCORBA, "up", *options), 60.0)
        assert f"port {port} on 127.0.0.1, wanted for the console, is in use" in said
        alone = launch(ROBOCORBA, "console", "--port", "0", "--state", str(system.state))
        assert Running(alone, system.state, system.naming).wait_ready().stop(signal.SIGINT) == 0
        check_end(system, supervisor)


def check_console(system: Running, supervisor: RemoteSupervisor) -> None:
    address = system.record().console_address
    assert any(line.startswith("console\t") and line.endswith(f"\t{address}") for line in system.printed)
    with urllib.request.urlopen(address, timeout=60.0) as page:
        assert b"RoboCorba" in page.read()
    names = [state.name for state in supervisor.processes()]
    assert names[:6] == ["omniNames", "map_editor", "simulation", "sensor_s1", "events_main", "console"]
    assert [row["name"] for row in call(system, "processes")] == names
    assert call(system, "rights") == {"administrator": True, "supervisor": True}
    assert call(system, "set_pace", pace=-1).startswith("pace: -1.0 is not")
    assert supervisor.log_lines("omniNames", 3)
    assert stat.S_IMODE((system.state / SUPERVISOR).stat().st_mode) == 0o600


def check_refusals(supervisor: RemoteSupervisor) -> None:
    for order, field in (
        (RobotOrder("--help"), "name"),
        (RobotOrder("A/../B"), "name"),
        (RobotOrder("A", adaptor="nothing"), "adaptor"),
        (RobotOrder("A", adaptor_arguments=("x",) * 65), "adaptorArguments"),
        (RobotOrder("A", floor="nowhere"), "onFloor"),
        (RobotOrder("A", at=(float("nan"), 0.0, 0.0)), "x"),
        (RobotOrder("A", channel="nowhere"), "channel"),
    ):
        with pytest.raises(InvalidChoice) as raised:
            supervisor.start_robot(order)
        assert raised.value.field == field
    for name in ("nobody", "simulation", "", "../up"):
        with pytest.raises(UnknownProcess):
            supervisor.end_robot(name)


def check_robots(system: Running, supervisor: RemoteSupervisor) -> None:
    """They start, end, are killed, and say why they can't start."""
    supervisor.start_robot(RobotOrder("R1", channel="main"))
    with pytest.raises(ProcessExists):
        supervisor.start_robot(RobotOrder("R1"))
    assert call(system, "start_robot", name="R2", x=3.0, y=4.0, heading=-1.5) is None
    for name in ("robot_R1", "robot_R2"):
        wait_for(supervisor, name, ProcessPhase.READY)
    processes = [psutil.Process(state.pid) for state in supervisor.processes() if state.robot]
    assert wait_for(supervisor, "robot_R1", ProcessPhase.READY).bound_names == ("RoboCorba/Robots/R1",)
    # Ready before it is bound only where the naming service did not answer for seconds.
    bound = "bound RoboCorba/Robots/R2"
    log = functools.partial(call, system, "log_lines", process="robot_R2", lines=50)
    eventually(lambda: any(bound in line for line in log()), START_S, "R2 is bound")

    supervisor.end_robot("R1")
    eventually(lambda: state_of(supervisor, "robot_R1") is None, what="R1 ended")
    os.kill(processes[1].pid, signal.SIGKILL)
    assert wait_for(supervisor, "robot_R2", ProcessPhase.ENDED).problem == "ended by SIGKILL"
    assert not any(map(is_running, processes))
    assert call(system, "end_robot", robot="R2") is None
    assert state_of(supervisor, "robot_R2") is None
    supervisor.start_robot(RobotOrder("R3", adaptor="corba", adaptor_arguments=("nobody",)))
    assert "R3" in wait_for(supervisor, "robot_R3", ProcessPhase.ENDED).problem
    supervisor.end_robot("robot_R3")


def check_kill(system: Running, supervisor: RemoteSupervisor) -> None:
    """A killed console comes back at its address, and still has its past, with a gap."""
    before = wait_for(supervisor, "console", ProcessPhase.READY)
    [seen] = [each for each in call(system, "happenings") if each["text"] == "R2 has logged on"]
    os.kill(before.pid, signal.SIGKILL)
    killed_at = time.time()
    eventually(lambda: (now := state_of(supervisor, "console")) and now.restarts == before.restarts + 1)
    wait_for(supervisor, "console", ProcessPhase.READY)
    assert call(system, "rights")["administrator"]
    eventually(lambda: {**seen, "at": 0.0} in [{**each, "at": 0.0} for each in call(system, "happenings")])
    assert b'"name":"R2"' in past(system, seen["at"] + 1.0)
    assert any(b'"came":[]' in past(system, killed_at + 0.1 * step) for step in range(-20, 20))
    eventually(lambda: b'"came":[{' in past(system, time.time()), what="what is seen now")
    eventually(lambda: call(system, "past_on_disk")["mib"] > 0.0, what="the past on disk")


def check_end(system: Running, supervisor: RemoteSupervisor) -> None:
    """All ends with the system, its robots too."""
    supervisor.start_robot(RobotOrder("R4"))
    wait_for(supervisor, "robot_R4", ProcessPhase.READY)
    system.note_descendants()
    assert system.stop(signal.SIGKILL) == -signal.SIGKILL
    eventually(lambda: not system.left_behind(), what="all processes ended")
    with pytest.raises(NotReachable):
        supervisor.processes()
    with pytest.raises(OSError):  # refused, or reset while the last process closes its socket
        call(system, "rights")
