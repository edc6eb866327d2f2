"""The console and the supervisor of a running system: robots as its processes, killed and restarted."""

from __future__ import annotations

import functools
import json
import os
import signal
import stat
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from robocorba.corba.orb import Orb
from robocorba.corba.remote.supervisor import RemoteSupervisor
from robocorba.errors.services import NotReachable, ProcessExists, UnknownProcess
from robocorba.errors.simulation import InvalidChoice
from robocorba.names import SUPERVISOR
from robocorba.processes import ProcessPhase, ProcessState, RobotOrder
from robocorba.testing.processes import ROBOCORBA, Running, eventually, is_running, refusal, running_system

pytest.importorskip("nicegui", reason="the console's packages are not installed")
pytestmark = pytest.mark.system

#: Timeout for a process to get ready on a busy machine [s].
START_S = 90.0


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_system(tmp_path_factory.mktemp("console"), "--console", "--console-port", "0") as (running, _):
        yield running


@pytest.fixture(scope="module")
def orb(system: Running) -> Iterator[Orb]:
    with Orb(system.naming) as orb:
        yield orb


@pytest.fixture
def supervisor(system: Running, orb: Orb) -> RemoteSupervisor:
    return RemoteSupervisor(orb, system.state / SUPERVISOR)


def call(system: Running, operation: str, /, **arguments: Any) -> Any:
    """The answer of an operation, or its error as a text."""
    request = urllib.request.Request(
        f"{system.record().console_address}call/{operation}", json.dumps(arguments).encode()
    )
    request.add_header("Content-Type", "application/json")
    with urllib.request.urlopen(request, timeout=30.0) as answer:
        content = json.load(answer)
    return content["error"] if "error" in content else content["answer"]


def state_of(supervisor: RemoteSupervisor, name: str) -> ProcessState | None:
    return next((state for state in supervisor.processes() if state.name == name), None)


def is_in(supervisor: RemoteSupervisor, name: str, phase: ProcessPhase) -> bool:
    state = state_of(supervisor, name)
    return state is not None and state.phase is phase


def test_the_console_is_a_process_of_the_system(system: Running, supervisor: RemoteSupervisor) -> None:
    address = system.record().console_address
    assert any(line.startswith("console\t") and line.endswith(f"\t{address}") for line in system.printed)
    with urllib.request.urlopen(address, timeout=30.0) as page:
        assert b"RoboCorba" in page.read()
    names = [state.name for state in supervisor.processes()]
    assert names[:6] == ["omniNames", "map_editor", "simulation", "sensor_s1", "events_main", "console"]
    assert [row["name"] for row in call(system, "processes")] == names
    assert call(system, "rights") == {"administrator": True, "supervisor": True}
    assert call(system, "set_pace", pace=-1).startswith("pace: -1.0 is not")
    assert supervisor.log_lines("omniNames", 3)


def test_only_this_user_can_read_the_reference(system: Running) -> None:
    assert stat.S_IMODE((system.state / SUPERVISOR).stat().st_mode) == 0o600


def test_robots_start_and_end(system: Running, supervisor: RemoteSupervisor) -> None:
    supervisor.start_robot(RobotOrder("R1", channel="main"))
    with pytest.raises(ProcessExists):
        supervisor.start_robot(RobotOrder("R1"))
    assert call(system, "start_robot", name="R2", x=3.0, y=4.0, heading=-1.5) is None
    for name in ("R1", "R2"):
        eventually(lambda: is_in(supervisor, f"robot_{name}", ProcessPhase.READY), START_S, f"{name} ready")  # noqa: B023
    processes = [psutil.Process(state.pid) for state in supervisor.processes() if state.robot]
    assert state_of(supervisor, "robot_R1").bound_names == ("RoboCorba/Robots/R1",)  # type: ignore[union-attr]
    # Ready before it is bound only where the naming service did not answer for seconds.
    bound = "bound RoboCorba/Robots/R2"
    log = functools.partial(call, system, "log_lines", process="robot_R2", lines=50)
    eventually(lambda: any(bound in line for line in log()), START_S, "R2 is bound")

    supervisor.end_robot("R1")
    eventually(lambda: state_of(supervisor, "robot_R1") is None, 60.0, "R1 ended")
    os.kill(processes[1].pid, signal.SIGKILL)
    eventually(lambda: is_in(supervisor, "robot_R2", ProcessPhase.ENDED), 30.0, "the end of R2 is shown")
    assert state_of(supervisor, "robot_R2").problem == "ended by SIGKILL"  # type: ignore[union-attr]
    assert not any(map(is_running, processes))
    assert call(system, "end_robot", robot="R2") is None
    assert state_of(supervisor, "robot_R2") is None


def test_a_robot_that_can_not_start_says_why(supervisor: RemoteSupervisor) -> None:
    supervisor.start_robot(RobotOrder("R3", adaptor="corba", adaptor_arguments=("nobody",)))
    eventually(lambda: is_in(supervisor, "robot_R3", ProcessPhase.ENDED), START_S, "R3 ended")
    assert "R3" in state_of(supervisor, "robot_R3").problem  # type: ignore[union-attr]
    supervisor.end_robot("robot_R3")


@pytest.mark.parametrize(
    ("order", "field"),
    [
        (RobotOrder("--help"), "name"),
        (RobotOrder("A/../B"), "name"),
        (RobotOrder("A", adaptor="nothing"), "adaptor"),
        (RobotOrder("A", adaptor_arguments=("x",) * 65), "adaptorArguments"),
        (RobotOrder("A", floor="nowhere"), "onFloor"),
        (RobotOrder("A", at=(float("nan"), 0.0, 0.0)), "x"),
        (RobotOrder("A", channel="nowhere"), "channel"),
    ],
)
def test_orders_that_make_no_sense_are_refused(order: RobotOrder, field: str, supervisor: RemoteSupervisor) -> None:
    with pytest.raises(InvalidChoice) as raised:
        supervisor.start_robot(order)
    assert raised.value.field == field


@pytest.mark.parametrize("name", ["nobody", "simulation", "", "../up"])
def test_only_robots_that_were_started_here_are_ended(name: str, supervisor: RemoteSupervisor) -> None:
    with pytest.raises(UnknownProcess):
        supervisor.end_robot(name)


def test_a_killed_console_comes_back_at_its_address(system: Running, supervisor: RemoteSupervisor) -> None:
    before = state_of(supervisor, "console")
    assert before is not None
    os.kill(before.pid, signal.SIGKILL)

    def is_back() -> bool:
        now = state_of(supervisor, "console")
        return now is not None and now.phase is ProcessPhase.READY and now.restarts == before.restarts + 1

    eventually(is_back, START_S, "the console restarted")
    assert call(system, "rights")["administrator"]


def test_a_port_in_use_is_one_line(system: Running, tmp_path: Path) -> None:
    from robocorba.claimed_ports import claimed_ports
    from robocorba.testing.processes import Launcher

    port = system.record().console_address.rstrip("/").rpartition(":")[2]
    with Launcher(tmp_path) as launch, claimed_ports() as naming:
        options = ("--state", "state", "--naming-port", str(naming), "--console", "--console-port", port)
        said = refusal(launch(ROBOCORBA, "up", *options), 60.0)
    assert f"port {port} on 127.0.0.1, wanted for the console, is in use" in said


def test_all_ends_with_the_system(orb: Orb, tmp_path: Path) -> None:
    with running_system(tmp_path, "--console", "--console-port", "0") as (system, _):
        supervisor = RemoteSupervisor(orb, system.state / SUPERVISOR)
        supervisor.start_robot(RobotOrder("R4"))
        eventually(lambda: is_in(supervisor, "robot_R4", ProcessPhase.READY), START_S, "R4 ready")
        assert call(system, "rights") == {"administrator": True, "supervisor": True}
        system.note_descendants()
        assert system.stop(signal.SIGKILL) == -signal.SIGKILL
        eventually(lambda: not system.left_behind(), 30.0, "all processes ended")
        with pytest.raises(NotReachable):
            supervisor.processes()
        with pytest.raises(OSError):  # refused, or reset while the last process closes its socket
            call(system, "rights")
