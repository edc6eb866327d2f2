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
from omniORB import CORBA

from robocorba.control.agent_state import AgentCondition
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.programs import program
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.stubs import RTC, SDOPackage
from robocorba.testing.json_process import Process
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, eventually

pytest.importorskip("rtctree", reason="rtshell-aist is not installed")
pytestmark = [pytest.mark.system, pytest.mark.full]

PATIENCE_S = 60.0
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
def agents(
    system: Running, system_orb: Orb, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, RemoteAgent]]:
    """A on L1, B/2 on L2."""
    with Launcher(tmp_path_factory.mktemp("robots")) as launch:
        for name, floor in (("A", "L1"), ("B.2", "L2")):
            launch(
                *(ROBOCORBA, "robot", name, "--floor", floor, "--at", "5,4", "--state", str(system.state)),
                ROBOCORBA_NAMING=str(system.naming),
            )
        yield {name: RemoteAgent(system_orb, name, PATIENCE_S) for name in ("A", "B.2")}


@pytest.fixture(scope="module")
def door(
    system: Running, system_orb: Orb, agents: dict[str, RemoteAgent], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Door]:
    with Launcher(tmp_path_factory.mktemp("door")) as launch:
        door = Door(system, system_orb, launch)
        eventually(lambda: door.state("A") and door.state("B_2"), PATIENCE_S, "names in the naming service")
        yield door


class Peer:
    """A foreign component. Called with the name of a command and its arguments, it answers."""

    def __init__(self, process: Process) -> None:
        self.process = process

    def __call__(self, do: str, **arguments: Any) -> Any:
        return self.process.ask({"do": do, **arguments}, PATIENCE_S)


@pytest.fixture
def peer(system: Running, door: Door, tmp_path: Path) -> Iterator[Peer]:
    """It is connected to all ports of A."""
    process = Process(
        (sys.executable, str(Path(__file__).with_name("rt_peer.py")), str(system.naming)), tmp_path / "peer.log", (), {}
    )
    process.receive(PATIENCE_S)
    eventually(lambda: door.state("Peer"), PATIENCE_S, "the peer")
    for out, into in (
        ("/A.rtc:pose", "/Peer.rtc:pose"),
        ("/Peer.rtc:range", "/A.rtc:range"),  # from the other side
        ("/A.rtc:floor", "/Peer.rtc:floor"),
        ("/Peer.rtc:velocity", "/A.rtc:velocity"),
    ):
        door.run("rtcon", out, into)
    yield Peer(process)
    process.kill()


def x_of(agent: RemoteAgent) -> float:
    return float(agent.state().at.x)


def test_tools_show_the_robots(door: Door) -> None:
    assert {*door.run("rtls", "/").split()} >= {"A.rtc", "B_2.rtc", "RoboCorba/"}
    shown = door.run("rtcat", "-ll", "/B_2.rtc")
    for text in ("Inactive", "RoboCorbaRobot", "pose", "floor", "range", "velocity", "B.2", "IDL:RTC/TimedPose2D:1.0"):
        assert text in shown
    assert "velocity_valid_for" in door.run("rtconf", "-l", "/A.rtc", "list")
    door.run("rtconf", "/A.rtc", "set", "velocity_valid_for", "0.8")
    assert door.run("rtconf", "/A.rtc", "get", "velocity_valid_for").strip() == "0.8"
    assert door.tool("rtconf", "/A.rtc", "set", "velocity_valid_for", "1000").returncode
    assert door.run("rtconf", "/A.rtc", "get", "velocity_valid_for").strip() == "0.8"


def test_a_foreign_component_sees_and_drives_a_robot(door: Door, agents: dict[str, RemoteAgent], peer: Peer) -> None:
    a = agents["A"]
    before = x_of(a)
    assert peer("send", velocity=AHEAD) == ["PORT_OK"]  # nobody drives an inactive robot
    assert (x_of(a), peer("poses")) == (before, [])

    door.run("rtact", "/A.rtc")
    assert door.state("A") == "Active"

    def has_driven() -> bool:
        assert peer("send", velocity=AHEAD) == ["PORT_OK"]
        return x_of(a) > before + 0.3

    eventually(has_driven, PATIENCE_S, "A drives")
    door.run("rtdeact", "/A.rtc")
    assert door.state("A") == "Inactive"
    eventually(lambda: a.state().condition is AgentCondition.IDLE, PATIENCE_S, "A stands")
    at = a.state().at
    assert at.y == pytest.approx(4.0, abs=0.02)

    poses = peer("poses")
    assert len(poses) > 5
    assert [pose[0] for pose in poses] == sorted({pose[0] for pose in poses})
    assert poses[-1][1] > before + 0.2
    assert set(peer("floors")) == {"L1"}
    scan = peer("last_range")
    assert len(scan["ranges"]) == 181
    config = scan["config"]
    assert (config["minAngle"], config["maxAngle"]) == pytest.approx((-math.pi / 2, math.pi / 2))
    assert config["angularRes"] == pytest.approx(math.pi / 180)
    # To the right is the outline.
    assert scan["ranges"][0] == pytest.approx(4.0, abs=0.05)
    assert peer("send_octets", count=7) == ["PORT_ERROR"]
    door.run("rtdis", "/A.rtc")
    assert peer("connections") == 0


def test_an_emergency_stop_is_an_error_state(door: Door, agents: dict[str, RemoteAgent]) -> None:
    a = agents["A"]
    door.run("rtact", "/A.rtc")
    a.stop()
    eventually(lambda: door.state("A") == "Error", PATIENCE_S, "the error state")
    assert "emergency stop" in door.run("rtcat", "-ll", "/A.rtc")
    door.run("rtreset", "/A.rtc")
    assert door.state("A") == "Inactive"
    assert a.state().condition is AgentCondition.IDLE


def test_a_robot_with_a_program_is_not_driven(door: Door, agents: dict[str, RemoteAgent], peer: Peer) -> None:
    a = agents["A"]
    a.load(program.dumps(ProgramBuilder("waits").wait(300.0).program()))
    a.run()
    door.run("rtact", "/A.rtc")
    before = x_of(a)
    for _ in range(3):
        peer("send", velocity=AHEAD)
    assert a.state().condition is AgentCondition.RUNNING
    assert (x_of(a), door.state("A")) == (before, "Active")
    a.abort()
    door.run("rtdeact", "/A.rtc")


def test_connections_end_with_their_component(door: Door, peer: Peer) -> None:
    ports = door.component("A").get_ports()
    assert all(port.get_connector_profiles() for port in ports)
    peer.process.kill()
    eventually(lambda: not any(port.get_connector_profiles() for port in ports), PATIENCE_S, "the end of connections")


def test_what_is_no_connection_is_refused(door: Door) -> None:
    """By plain CORBA, with what no tool would send."""
    component = door.component("A")
    pose = next(port for port in component.get_ports() if port.get_port_profile().name == "A.pose")

    def connect(ports: list[Any], **properties: str) -> Any:
        values = [
            SDOPackage.NameValue(f"dataport.{name}", CORBA.Any(CORBA.TC_string, value))
            for name, value in properties.items()
        ]
        return pose.connect(RTC.ConnectorProfile("", "", ports, values))[0]

    assert connect([]) is RTC.BAD_PARAMETER
    assert connect([None]) is RTC.BAD_PARAMETER
    assert connect([component]) is RTC.BAD_PARAMETER
    assert connect([pose], dataflow_type="flood") is RTC.UNSUPPORTED
    assert connect([pose], data_type="IDL:RTC/TimedLong:1.0") is RTC.BAD_PARAMETER
    assert connect([pose]) is RTC.BAD_PARAMETER  # nowhere to put data
    assert connect([pose], dataflow_type="pull") is RTC.RTC_OK
    assert pose.disconnect_all() is RTC.RTC_OK
    context = component.get_owned_contexts()[0]
    assert context.activate_component(None) is RTC.BAD_PARAMETER
    assert context.set_rate(1000.0) is RTC.BAD_PARAMETER
    assert component.exit() is RTC.UNSUPPORTED


def test_components_come_and_go_with_their_robots(door: Door, system: Running, tmp_path: Path) -> None:
    with Launcher(tmp_path) as launch:
        robot = launch(
            *(ROBOCORBA, "robot", "C", "--floor", "L2", "--at", "8,4", "--state", str(system.state)),
            ROBOCORBA_NAMING=str(system.naming),
        )
        eventually(lambda: door.state("C") == "Inactive", PATIENCE_S, "C")
        robot.send_signal(signal.SIGTERM)
        eventually(lambda: door.state("C") == "", PATIENCE_S, "no C")
    assert door.state("A") == "Inactive"


def test_the_door_may_be_killed_and_ends_without_a_trace(
    door: Door, agents: dict[str, RemoteAgent], peer: Peer
) -> None:
    """A robot that was driven stands; the names are those of the new process; connections are made again."""
    a = agents["A"]
    before = x_of(a)
    door.run("rtact", "/A.rtc")
    eventually(lambda: peer("send", velocity=AHEAD) and peer("poses") and x_of(a) > before + 0.1, PATIENCE_S, "driving")
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
