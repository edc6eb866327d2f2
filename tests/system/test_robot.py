"""Robot processes: programs over CORBA, emergency stops, servers that go away meanwhile, and a fleet."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from robocorba.errors.robots import AdaptorFailed, IllegalOrder, InvalidProgram, UnknownAdaptor
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent, robots
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Event
from robocorba.robot.programs.program import dumps
from robocorba.simulation.corba.registered_robots import floors_of_robots
from robocorba.stubs import RoboCorba
from testkit.processes import Running, command_line, drain, eventually, hang, is_running, refusal
from tests.robot.kinematics.postures import links_by_urdf
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.slow(70)]

PATIENCE_S = 120.0
Start = Callable[..., "subprocess.Popen[str]"]
StartRobot = Callable[..., RemoteAgent]
LONG = ProgramBuilder("long").mbase_velocity(0.2, 0.0, 0.0, 60.0).program()


@pytest.fixture
def start(robocorba: Start, system_orb: Orb) -> Iterator[StartRobot]:
    """Starts `robocorba robot`, and waits until it is ready."""
    started = []

    def run(name: str, *arguments: str) -> RemoteAgent:
        started.append(robocorba("robot", name, "--floor", "L1", *arguments))
        out, err = started[-1].stdout, started[-1].stderr
        assert out is not None and err is not None
        assert out.readline() == "ready\n", err.read()
        return RemoteAgent(system_orb, name)

    yield run
    for process in started:
        process.send_signal(signal.SIGTERM)
    for process in started:
        process.communicate(timeout=PATIENCE_S)


def has_ended(agent: RemoteAgent) -> bool:
    return agent.state().program.result is not ProgramResult.NO_RESULT


def ended(agent: RemoteAgent) -> AgentState:
    eventually(lambda: has_ended(agent), PATIENCE_S, "the end of the program")
    return agent.state()


def drive(agent: RemoteAgent) -> None:
    """Until it moves."""
    agent.load(dumps(LONG))
    agent.run()
    eventually(lambda: agent.state().actor.velocity[0] > 0.15, PATIENCE_S, "moving")


def works(agent: RemoteAgent) -> bool:
    """Whether it does a program to its end."""
    agent.load(dumps(ProgramBuilder("x").mbase_by(ahead=0.1).program()))
    agent.run()
    return ended(agent).program.result is ProgramResult.DONE


def test_agents_refuse_what_makes_no_sense_and_wait_for_each_other(start: StartRobot, system_orb: Orb) -> None:
    agents = c, d = start("C", "--at", "3,2", "--channel", "main"), start("D", "--at", "3,8", "--channel", "main")
    with pytest.raises(IllegalOrder, match="has none loaded"):
        c.run()
    with pytest.raises(InvalidProgram) as wrong:
        c.load(json.dumps({"name": "x", "icons": [{"icon": "wait", "seconds": -1}]}))
    assert (wrong.value.icon, wrong.value.parameter) == ("icons[0]", "seconds")
    with pytest.raises(UnknownAdaptor, match="known are corba, ros2, simulated, smartpal"):
        c.switch("hovering", [])
    with pytest.raises(AdaptorFailed, match="Adaptors/C is not reachable"):
        c.switch("corba", [])
    assert c.state().adaptor == "simulated"
    with pytest.raises(NotReachable, match="Robots/nobody is not reachable"):
        RemoteAgent(system_orb, "nobody", 0.3)
    ask = ProgramBuilder("ask").wait(0.5).say("go").wait_until(Event("gone", "D"), 20.0).program()
    answer = ProgramBuilder("answer").wait_until(Event("go", "C"), 20.0).mbase_by(ahead=0.2).say("gone").program()
    c.load(dumps(ask))
    d.load(dumps(answer))
    d.run()
    c.run()
    assert [ended(agent).program.result for agent in agents] == [ProgramResult.DONE, ProgramResult.DONE]


def test_where_the_links_of_a_robot_are(start: StartRobot, system_orb: Orb) -> None:
    agent = start("L", "--at", "3,5,0.7")
    agent.load(dumps(ProgramBuilder("reach").mhand_posture("both", "reach").mbase_by(turn=0.5).program()))
    agent.run()
    assert ended(agent).program.result is ProgramResult.DONE
    state = agent.state()
    found = system_orb.resolve("Robots/L", RoboCorba.RobotAgent)._get_linkPoses()
    assert (found.onFloor, found.time >= state.actor.time) == ("L1", True)
    expected = links_by_urdf((state.at.x, state.at.y, state.at.heading), state.actor.joints)
    assert {link.link for link in found.links} == {"base", *expected}
    for link in found.links[1:]:
        position, attitude = expected[link.link]
        assert (link.x, link.y, link.z) == pytest.approx(position, abs=0.002), link.link
        assert abs(np.dot((link.qw, link.qx, link.qy, link.qz), attitude)) == pytest.approx(1.0, abs=1e-5)


def test_an_emergency_stop_by_the_command(
    start: StartRobot, system: Running, system_orb: Orb, robocorba: Start
) -> None:
    agent = start("E", "--at", "3,5")
    drive(agent)
    out, _ = robocorba("stop", "--all").communicate(timeout=PATIENCE_S)
    assert "E\tstands" in ["\t".join(row.split("\t")[:2]) for row in out.splitlines()]
    state = ended(agent)
    assert (state.condition, state.reason, state.program.result) == (
        AgentCondition.STOPPED,
        "emergency stop",
        ProgramResult.ABORTED,
    )
    eventually(lambda: stands(system_orb, "E"))
    assert refusal(robocorba("stop", "nobody")).startswith("nobody\tRoboCorba/Robots/nobody is not reachable")
    for name in ("nobody", "E"):  # a name may be held before its robot is there
        out_of_one = robocorba("stop", name, "--reset", "--state", str(system.state)).communicate(timeout=PATIENCE_S)[0]
        assert out_of_one == f"{name}\tmay move again\n"
    assert "nobody" in refusal(robocorba("stop", "nobody", "--reset", "--state", str(system.state)))
    assert "*\tholds\trobots that log on are stopped, too" in out
    late = start("F", "--at", "6,5").state()
    assert late.condition is AgentCondition.STOPPED and "robocorba stop --all --reset" in late.reason
    out = robocorba("stop", "--all", "--reset").communicate(timeout=PATIENCE_S)[0]
    assert {"*\tmay move again", "E\tmay move again", "F\tmay move again"} <= set(out.splitlines())
    assert works(agent)
    # Without the naming service, by what the state folder knows; the name of the robot can't be asked for.
    drive(agent)
    hang(naming := system.pid("omniNames"))
    try:
        out, _ = robocorba("stop", "E", "--state", str(system.state)).communicate(timeout=PATIENCE_S)
    finally:
        os.kill(naming, signal.SIGCONT)
    assert out.startswith("E\tstands\t")
    assert ended(agent).condition is AgentCondition.STOPPED


def stands(orb: Orb, name: str) -> bool:
    """Whether the simulation server has a robot at the same place for half a second."""
    before, _ = body_at(orb, name), pause(0.5)
    return body_at(orb, name) == pytest.approx(before, abs=1e-3)


def body_at(orb: Orb, name: str) -> tuple[float, float]:
    """Where the simulation server has a robot."""
    server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    (client,) = [client for client in server.clients() if client.name == name]
    return client.at.x, client.at.y


def test_a_robot_whose_process_hangs_or_dies_stands(robocorba: Start, system_orb: Orb) -> None:
    process = robocorba("robot", "F", "--floor", "L1", "--at", "3,5")
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    drive(RemoteAgent(system_orb, "F"))
    hang(process.pid)
    at = body_at(system_orb, "F")
    eventually(lambda: stands(system_orb, "F"))  # the command ends after 0.1 s
    assert math.dist(body_at(system_orb, "F"), at) < 0.3
    os.kill(process.pid, signal.SIGKILL)
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    eventually(lambda: all(client.name != "F" for client in server.clients()), what="its lease")


def test_the_simulation_server_is_killed_and_hangs(start: StartRobot, system: Running) -> None:
    """A program goes on if the server is back soon, and fails otherwise; then the robot works again."""
    agent = start("K", "--at", "3,5")
    for _ in range(5):  # on a busy machine a restart may take longer than robots wait
        drive(agent)
        killed = system.pid("simulation")
        os.kill(killed, signal.SIGKILL)
        eventually(lambda killed=killed: system.pid("simulation") != killed, PATIENCE_S, "the restart")
        x = agent.state().at.x
        eventually(lambda x=x: agent.state().at.x > x + 0.2 or has_ended(agent), PATIENCE_S, "driving on")
        if not has_ended(agent):
            break
        eventually(lambda: agent.state().condition is AgentCondition.IDLE, PATIENCE_S, "back")
    assert not has_ended(agent), "it never drove on"
    hung = system.pid("simulation")
    hang(hung)
    state = ended(agent)
    assert state.program.result is ProgramResult.FAILED
    assert "simulation server" in state.program.reason
    os.kill(hung, signal.SIGCONT)
    eventually(lambda: agent.state().condition is AgentCondition.IDLE, PATIENCE_S, "back")
    x = agent.state().at.x
    assert x > 3.0 and works(agent)
    assert agent.state().at.x == pytest.approx(x + 0.1, abs=0.01)


def test_pause_step_and_end_by_the_command(start: StartRobot, robocorba: Start, tmp_path: Path) -> None:
    agent = start("H", "--at", "3,5")
    program = ProgramBuilder("turns")
    with program.repeat(20):
        program.mbase_by(turn=0.3)
    (tmp_path / "turns.json").write_text(dumps(program.program()))
    process = robocorba("program", "run", "turns.json", "--robot", "H", "--step")
    eventually(lambda: agent.state().condition is AgentCondition.PAUSED, PATIENCE_S, "before the first icon")
    assert robocorba("program", "step", "H").communicate(timeout=PATIENCE_S)[1] == ""
    eventually(lambda: agent.state().program.icon == "icons[0].icons[0]", PATIENCE_S, "the second")
    assert robocorba("program", "resume", "H").communicate(timeout=PATIENCE_S)[1] == ""
    eventually(lambda: agent.state().program.icons_done > 2, PATIENCE_S, "some of them")
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert out.splitlines()[-1].startswith("aborted\t")
    assert abs(math.hypot(*agent.state().actor.velocity)) < 0.6
    assert refusal(robocorba("program", "pause", "H")) == (
        "robocorba program pause: can't pause: the robot runs no program"
    )


def test_what_a_robot_process_refuses(robocorba: Start) -> None:
    for arguments, said in (
        ("--at 1,2", "--at is '1,2': needs --floor"),
        ("--floor L1 --at 10,1", "L1:10,1 is not free: a wall"),
        ("--floor L1 --adaptor hovering", "there is no adaptor 'hovering'"),
    ):
        assert said in refusal(robocorba("robot", "I", *arguments.split()))


# ---- a fleet ----

FLEET = """
defaults: {floor: L1}
robots:
  - {name: Lead, program: wait.json}
  - {prefix: F, count: 2}
"""


class Fleet:
    """A running `robocorba robots` and the lines that it has printed, once all robots have started."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process, self.lines = process, list[str]()
        drain(process)
        threading.Thread(target=lambda: self.lines.extend(process.stdout or ()), daemon=True).start()
        self.wait_for("ready")

    def wait_for(self, line: str) -> None:
        eventually(lambda: f"{line}\n" in self.lines, PATIENCE_S, line)

    def kill(self, robot: str) -> None:
        children = psutil.Process(self.process.pid).children()
        robot_client = f"robocorba.clients.robot {robot} "
        os.kill(next(child.pid for child in children if robot_client in command_line(child)), signal.SIGKILL)

    def end(self, number: signal.Signals) -> int:
        """Its exit code."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


def test_one_dies_the_others_go_on_and_all_log_off(robocorba: Start, system_orb: Orb, tmp_path: Path) -> None:
    (tmp_path / "fleet.yaml").write_text(FLEET)
    (tmp_path / "wait.json").write_text(dumps(ProgramBuilder("waiting").wait(600.0).program()))
    fleet, floors = Fleet(robocorba("robots", "fleet.yaml")), floors_of_robots(system_orb)
    assert floors().items() >= {"Lead": "L1", "F1": "L1", "F2": "L1"}.items()
    fleet.wait_for("Lead\tL1\twaiting\twaiting\t0\twaiting for 600 s")
    fleet.kill("F1")
    fleet.wait_for("F1\tL1\tended\t\t0\tended by SIGKILL")
    assert RemoteAgent(system_orb, "Lead").state().program.name == "waiting"
    assert RemoteAgent(system_orb, "F2").state().at.floor == "L1"
    family = psutil.Process(fleet.process.pid).children(recursive=True)
    assert fleet.end(signal.SIGINT) == 1  # one failed
    assert not {"Lead", "F2"} & {*floors(), *robots(system_orb)}  # F1 stays until its lease expires
    eventually(lambda: not any(map(is_running, family)), what="all processes ended")


def test_a_robot_is_started_again_if_wanted(robocorba: Start, system_orb: Orb) -> None:
    fleet = Fleet(robocorba("robots", "--count", "1", "--prefix", "G", "--restart"))
    fleet.kill("G1")
    eventually(lambda: any(line.startswith("G1\tL1\twaiting\t\t") and "\t0\t" not in line for line in fleet.lines))
    assert RemoteAgent(system_orb, "G1").state().name == "G1"
    assert fleet.end(signal.SIGTERM) == 0
    assert "G1" not in floors_of_robots(system_orb)()
