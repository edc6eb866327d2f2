"""robocorba openrtm beside a running system: tools of OpenRTM see two robots, and a foreign component drives one.

The tools are rtshell's, as processes; the foreign component has rtctree's stubs."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs import program
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.stubs import RTC
from testkit.json_process import Process, checkout_command
from testkit.processes import ROBOCORBA, Launcher, Running, eventually
from testkit.virtual_and_actual import robot_process

pytest.importorskip("rtctree", reason="rtshell-aist is not installed")
pytestmark = [pytest.mark.system, pytest.mark.full]

PATIENCE_S = 120.0
BIN = Path(sys.executable).parent
AHEAD = (0.2, 0.0, 0.0)
STAND = (0.0, 0.0, 0.0)


class Door:
    """`robocorba openrtm`, and the tools of rtshell at its naming service."""

    def __init__(self, system: Running, orb: Orb, launch: Launcher) -> None:
        self._system, self._orb, self._launch = system, orb, launch
        self._tree = f"/{system.naming}"
        self.process = self.start()

    def start(self) -> Any:
        process = self._launch(ROBOCORBA, "openrtm", ROBOCORBA_NAMING=str(self._system.naming))
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line == f"{self._system.naming}: A.rtc, B_2.rtc\n", line or process.communicate(timeout=PATIENCE_S)[1]
        self.process = process
        return process

    def tool(self, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a tool; / at the beginning of arguments is the naming service."""
        paths = [self._tree + argument if argument.startswith("/") else argument for argument in arguments]
        environment = {"RTCTREE_NAMESERVERS": str(self._system.naming), "PATH": str(BIN)}
        return subprocess.run(
            [str(BIN / name), *paths], capture_output=True, text=True, env=environment, timeout=PATIENCE_S
        )

    def run(self, name: str, *arguments: str) -> str:
        """Run a tool that succeeds; what it prints."""
        ran = self.tool(name, *arguments)
        assert (ran.returncode, ran.stderr) == (0, ""), (name, arguments, ran.stdout, ran.stderr)
        return ran.stdout

    def state(self, name: str) -> str:
        """The state that `rtls -l` shows, such as Inactive; empty if the component is not there."""
        for line in self.tool("rtls", "-l", "/").stdout.splitlines():
            if line.split()[-1] == f"{name}.rtc":
                return line.split()[0]
        return ""

    def component(self, name: str) -> Any:
        """The component by plain CORBA."""
        return self._orb.resolve_in_other_naming_service(self._system.naming, f"{name}.rtc", RTC.RTObject, 5.0)


@pytest.fixture(scope="module")
def a(system_orb: Orb, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RemoteAgent]:
    """A on L1; B.2 is on L2."""
    folder = tmp_path_factory.mktemp("robots")
    with (
        robot_process(folder, system_orb, "A", "--floor", "L1", "--at", "5,4") as a,
        robot_process(folder, system_orb, "B.2", "--floor", "L2", "--at", "5,4"),
    ):
        yield a.agent


@pytest.fixture(scope="module")
def door(system: Running, system_orb: Orb, a: RemoteAgent, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Door]:
    with Launcher(tmp_path_factory.mktemp("door")) as launch:
        door = Door(system, system_orb, launch)
        eventually(lambda: door.state("A") and door.state("B_2"), PATIENCE_S, "names in the naming service")
        yield door


@pytest.fixture
def peer(system: Running, door: Door, tmp_path: Path) -> Iterator[Process]:
    """A foreign component, connected to all ports of A."""
    process = Process(checkout_command("tests.system.rt_peer", str(system.naming)), tmp_path / "peer.log", (), {})
    process.receive(PATIENCE_S)
    eventually(lambda: door.state("Peer"), PATIENCE_S, "the peer")
    connect(door)
    yield process
    process.kill()


def connect(door: Door) -> None:
    """All ports of A and of the peer."""
    for out, into in (
        ("/A.rtc:pose", "/Peer.rtc:pose"),
        ("/Peer.rtc:range", "/A.rtc:range"),  # from the other side
        ("/A.rtc:floor", "/Peer.rtc:floor"),
        ("/Peer.rtc:velocity", "/A.rtc:velocity"),
    ):
        door.run("rtcon", out, into)


def ask(peer: Process, do: str, **arguments: Any) -> Any:
    """The answer to a command."""
    return peer.ask({"do": do, **arguments}, PATIENCE_S)


def x_of(agent: RemoteAgent) -> float:
    return float(agent.state().at.x)


def test_tools_show_the_robots_that_are_there(door: Door, system_orb: Orb, tmp_path: Path) -> None:
    assert {*door.run("rtls", "/").split()} >= {"A.rtc", "B_2.rtc", "RoboCorba/"}
    shown = door.run("rtcat", "-ll", "/B_2.rtc")
    for text in ("Inactive", "RoboCorbaRobot", "pose", "floor", "range", "velocity", "B.2", "IDL:RTC/TimedPose2D:1.0"):
        assert text in shown
    assert "velocity_valid_for" in door.run("rtconf", "-l", "/A.rtc", "list")
    door.run("rtconf", "/A.rtc", "set", "velocity_valid_for", "0.8")
    assert door.tool("rtconf", "/A.rtc", "set", "velocity_valid_for", "1000").returncode
    assert door.run("rtconf", "/A.rtc", "get", "velocity_valid_for").strip() == "0.8"
    with robot_process(tmp_path, system_orb, "C", "--floor", "L2", "--at", "8,4"):
        eventually(lambda: door.state("C") == "Inactive", PATIENCE_S, "C")
    eventually(lambda: door.state("C") == "", PATIENCE_S, "no C")
    assert door.state("A") == "Inactive"
    # By plain CORBA, with what no tool would send.
    component = door.component("A")
    pose = next(port for port in component.get_ports() if port.get_port_profile().name == "A.pose")
    for ports in ([], [None], [component]):
        assert pose.connect(RTC.ConnectorProfile("", "", ports, []))[0] is RTC.BAD_PARAMETER
    assert component.get_owned_contexts()[0].activate_component(None) is RTC.BAD_PARAMETER
    assert component.exit() is RTC.UNSUPPORTED


def test_a_foreign_component_sees_and_drives_a_robot(door: Door, a: RemoteAgent, peer: Process) -> None:
    before = x_of(a)
    assert ask(peer, "send", velocity=AHEAD) == ["PORT_OK"]  # nobody drives an inactive robot
    assert (x_of(a), ask(peer, "poses")) == (before, [])

    door.run("rtact", "/A.rtc")
    assert door.state("A") == "Active"

    def has_driven() -> bool:
        assert ask(peer, "send", velocity=AHEAD) == ["PORT_OK"]
        has_come = len(ask(peer, "poses")) > 5 and ask(peer, "floors") and ask(peer, "last_range")
        return x_of(a) > before + 0.3 and bool(has_come)

    eventually(has_driven, PATIENCE_S, "A drives, and the peer knows of it")
    door.run("rtdeact", "/A.rtc")
    assert door.state("A") == "Inactive"
    eventually(lambda: a.state().condition is AgentCondition.IDLE, PATIENCE_S, "A stands")
    assert a.state().at.y == pytest.approx(4.0, abs=0.02)
    check_data(peer, before)
    door.run("rtdis", "/A.rtc")
    assert ask(peer, "connections") == 0
    connect(door)

    a.load(program.dumps(ProgramBuilder("waits").wait(300.0).program()))
    a.run()
    door.run("rtact", "/A.rtc")
    before = x_of(a)
    for _ in range(3):
        ask(peer, "send", velocity=AHEAD)
    assert a.state().condition is AgentCondition.RUNNING  # a robot with a program is not driven
    assert (x_of(a), door.state("A")) == (before, "Active")
    a.stop()
    eventually(lambda: door.state("A") == "Error", PATIENCE_S, "the error state")
    assert "emergency stop" in door.run("rtcat", "-ll", "/A.rtc")
    door.run("rtreset", "/A.rtc")
    assert door.state("A") == "Inactive"
    assert a.state().condition is AgentCondition.IDLE

    # The door may be killed, and ends without a trace: a robot that was driven stands.
    door.run("rtact", "/A.rtc")
    eventually(lambda: ask(peer, "send", velocity=AHEAD) and x_of(a) > before + 0.1, PATIENCE_S, "driving")
    door.process.kill()
    door.process.wait(PATIENCE_S)
    eventually(lambda: a.state().condition is AgentCondition.IDLE, PATIENCE_S, "A stands")
    door.start()
    eventually(lambda: door.state("A") == "Inactive", PATIENCE_S, "A by the new process")
    door.process.send_signal(signal.SIGTERM)
    assert door.process.wait(PATIENCE_S) == 0
    assert sorted(door.run("rtls", "/").split()) == ["Peer.rtc", "RoboCorba/"]
    door.start()
    eventually(lambda: door.state("A") and door.state("B_2"), PATIENCE_S, "a door for other tests")

    connect(door)
    ports = door.component("A").get_ports()
    assert all(port.get_connector_profiles() for port in ports)
    peer.kill()
    eventually(lambda: not any(port.get_connector_profiles() for port in ports), PATIENCE_S, "the end of connections")


def check_data(peer: Process, before: float) -> None:
    """What a peer has got from a robot that has driven from `before` on."""
    poses = ask(peer, "poses")
    assert [pose[0] for pose in poses] == sorted({pose[0] for pose in poses})
    assert poses[-1][1] > before + 0.2
    assert set(ask(peer, "floors")) == {"L1"}
    scan = ask(peer, "last_range")
    assert len(scan["ranges"]) == 181
    config = scan["config"]
    assert (config["minAngle"], config["maxAngle"]) == pytest.approx((-math.pi / 2, math.pi / 2))
    assert config["angularRes"] == pytest.approx(math.pi / 180)
    assert scan["ranges"][0] == pytest.approx(4.0, abs=0.05)  # to the right is the outline
    assert ask(peer, "send_octets", count=7) == ["PORT_ERROR"]
