"""Robot processes: programs over CORBA, emergency stops, and servers and networks that go away meanwhile."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocorba.control.agent_state import AgentCondition, AgentState, ProgramResult
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.errors.robots import AdaptorFailed, IllegalOrder, InvalidProgram, UnknownAdaptor
from robocorba.errors.services import NotReachable
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import Program, dumps
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import module_command
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, eventually, hang, refusal
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.slow]

PATIENCE_S = 40.0
Start = Callable[..., "subprocess.Popen[str]"]
LONG = ProgramBuilder("long").mbase_velocity(0.2, 0.0, 0.0, 60.0).program()


@pytest.fixture
def start(system: Running, tmp_path: Path) -> Iterator[Start]:
    """Starts `robocorba robot` and waits until it is ready."""
    with Launcher(tmp_path) as launch:
        started = []

        def run(*arguments: str) -> subprocess.Popen[str]:
            naming = {"ROBOCORBA_NAMING": str(system.naming), "ROBOCORBA_STATE": str(tmp_path / "state")}
            process = launch(ROBOCORBA, "robot", *arguments, **naming)
            assert process.stdout is not None and process.stderr is not None
            if process.stdout.readline() != "ready\n":
                raise AssertionError(process.stderr.read())
            started.append(process)
            return process

        yield run
        for process in started:
            process.send_signal(signal.SIGTERM)
        for process in started:
            process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def robocorba(system: Running, tmp_path: Path) -> Iterator[Start]:
    with Launcher(tmp_path) as launch:
        yield lambda *arguments: launch(ROBOCORBA, *arguments, ROBOCORBA_NAMING=str(system.naming))


def run(agent: RemoteAgent, program: Program) -> AgentState:
    """To its end."""
    agent.load(dumps(program))
    agent.run()
    return ended(agent)


def has_ended(agent: RemoteAgent) -> bool:
    return agent.state().program.result is not ProgramResult.NO_RESULT


def ended(agent: RemoteAgent) -> AgentState:
    eventually(lambda: has_ended(agent), PATIENCE_S, "the end of the program")
    return agent.state()


def moving(agent: RemoteAgent) -> None:
    eventually(lambda: agent.state().actor.velocity[0] > 0.15, PATIENCE_S, "moving")


def test_what_an_agent_refuses(start: Start, system_orb: Orb) -> None:
    start("B", "--floor", "L1", "--at", "3,5,0")
    agent = RemoteAgent(system_orb, "B")
    with pytest.raises(IllegalOrder, match="has none loaded"):
        agent.run()
    with pytest.raises(InvalidProgram) as wrong:
        agent.load(json.dumps({"name": "x", "icons": [{"icon": "wait", "seconds": -1}]}))
    assert (wrong.value.icon, wrong.value.parameter) == ("icons[0]", "seconds")
    with pytest.raises(InvalidProgram) as wrong:
        agent.load(dumps(ProgramBuilder("x").mbase_path("L9", 1.0, 1.0).program()))
    assert (wrong.value.icon, wrong.value.parameter) == ("icons[0]", "floor")
    with pytest.raises(UnknownAdaptor, match="known are corba, simulated, smartpal"):
        agent.switch("hovering", [])
    with pytest.raises(AdaptorFailed, match="Adaptors/B is not reachable"):
        agent.switch("corba", [])
    assert agent.state().adaptor == "simulated"
    assert run(agent, ProgramBuilder("x").mbase_by(ahead=0.1).program()).program.result is ProgramResult.DONE


def test_two_robots_wait_for_each_other(start: Start, system_orb: Orb) -> None:
    from robocorba.programs.icons import Event

    start("C", "--floor", "L1", "--at", "3,2,0", "--channel", "main")
    start("D", "--floor", "L1", "--at", "3,8,0", "--channel", "main")
    agents = [RemoteAgent(system_orb, name) for name in ("C", "D")]
    ask = ProgramBuilder("ask").wait(0.5).say("go").wait_until(Event("gone", "D"), 20.0).program()
    answer = ProgramBuilder("answer").wait_until(Event("go", "C"), 20.0).mbase_by(ahead=0.2).say("gone").program()
    for agent, program in zip(agents, (ask, answer), strict=True):
        agent.load(dumps(program))
    for agent in reversed(agents):
        agent.run()
    assert [ended(agent).program.result for agent in agents] == [ProgramResult.DONE, ProgramResult.DONE]


def test_an_emergency_stop_by_the_command(start: Start, system_orb: Orb, robocorba: Start) -> None:
    start("E", "--floor", "L1", "--at", "3,5,0")
    agent = RemoteAgent(system_orb, "E")
    agent.load(dumps(LONG))
    agent.run()
    moving(agent)
    process = robocorba("stop", "--all")
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert "E\tstands" in ["\t".join(row.split("\t")[:2]) for row in out.splitlines()]
    state = ended(agent)
    assert (state.condition, state.reason, state.program.result) == (
        AgentCondition.STOPPED,
        "emergency stop",
        ProgramResult.ABORTED,
    )
    eventually(lambda: stands(system_orb, "E"))
    assert refusal(robocorba("stop", "nobody")).startswith("nobody\tRoboCorba/Robots/nobody is not reachable")
    assert "*\tholds\trobots that log on are stopped, too" in out
    start("F", "--floor", "L1", "--at", "6,5,0")
    late = RemoteAgent(system_orb, "F").state()
    assert late.condition is AgentCondition.STOPPED and "robocorba stop --all --reset" in late.reason
    process = robocorba("stop", "--all", "--reset")
    out = process.communicate(timeout=PATIENCE_S)[0]
    assert {"*\tmay move again", "E\tmay move again", "F\tmay move again"} <= set(out.splitlines())
    assert run(agent, ProgramBuilder("x").mbase_by(ahead=0.1).program()).program.result is ProgramResult.DONE


def stands(orb: Orb, name: str) -> bool:
    """Whether the simulation server has a robot at the same place for half a second."""
    before, _ = session_state(orb, name), pause(0.5)
    return session_state(orb, name) == pytest.approx(before, abs=1e-3)


def session_state(orb: Orb, name: str) -> tuple[float, float]:
    """Where the simulation server has a robot."""
    server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    (client,) = [client for client in server.clients() if client.name == name]
    return client.at.x, client.at.y


def test_a_robot_whose_process_hangs_or_dies_stands(start: Start, system_orb: Orb) -> None:
    process = start("F", "--floor", "L1", "--at", "3,5,0")
    agent = RemoteAgent(system_orb, "F")
    agent.load(dumps(LONG))
    agent.run()
    moving(agent)
    hang(process.pid)
    at = session_state(system_orb, "F")
    eventually(lambda: stands(system_orb, "F"))  # the command ends after 0.1 s
    assert math.dist(session_state(system_orb, "F"), at) < 0.3
    os.kill(process.pid, signal.SIGKILL)
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    eventually(lambda: all(client.name != "F" for client in server.clients()), 30.0, "its lease")


def test_a_program_goes_on_when_the_simulation_server_was_killed(
    start: Start, system: Running, system_orb: Orb
) -> None:
    start("K", "--floor", "L1", "--at", "3,5,0")
    agent = RemoteAgent(system_orb, "K")
    for _ in range(5):  # on a busy machine a restart may take longer than robots wait
        agent.load(dumps(LONG))
        agent.run()
        moving(agent)
        killed = system.pid("simulation")
        os.kill(killed, signal.SIGKILL)
        eventually(lambda killed=killed: system.pid("simulation") != killed, PATIENCE_S, "the restart")
        x = agent.state().at.x
        eventually(lambda x=x: agent.state().at.x > x + 0.2 or has_ended(agent), PATIENCE_S, "driving on")
        if not has_ended(agent):
            agent.abort()
            assert ended(agent).program.result is ProgramResult.ABORTED
            return
        eventually(lambda: agent.state().condition is AgentCondition.IDLE, PATIENCE_S, "back")
    pytest.fail("it never drove on")


def test_the_simulation_server_hangs(start: Start, system: Running, system_orb: Orb) -> None:
    start("G", "--floor", "L1", "--at", "3,3,0")
    agent = RemoteAgent(system_orb, "G")
    agent.load(dumps(LONG))
    agent.run()
    moving(agent)
    hung = system.pid("simulation")
    hang(hung)
    state = ended(agent)
    assert state.program.result is ProgramResult.FAILED
    assert "simulation server" in state.program.reason
    os.kill(hung, signal.SIGCONT)
    eventually(lambda: agent.state().condition is AgentCondition.IDLE, PATIENCE_S, "back")
    x = agent.state().at.x
    assert x > 3.0
    assert run(agent, ProgramBuilder("x").mbase_by(ahead=0.2).program()).program.result is ProgramResult.DONE
    assert agent.state().at.x == pytest.approx(x + 0.2, abs=0.01)


def test_pause_step_and_end_by_the_command(start: Start, system_orb: Orb, robocorba: Start, tmp_path: Path) -> None:
    start("H", "--floor", "L1", "--at", "3,5,0")
    agent = RemoteAgent(system_orb, "H")
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


def test_what_a_robot_process_refuses(system: Running, tmp_path: Path) -> None:
    with Launcher(tmp_path) as launch:

        def robot(*arguments: str) -> str:
            command = (*module_command("robocorba.clients.robot"), *arguments, "--naming", str(system.naming))
            return refusal(launch(*command, ROBOCORBA_STATE=str(tmp_path / "state"), PYTHONPATH=str(Path.cwd())))

        assert robot("I", "--at", "1,2").endswith("--at is '1,2': needs --floor")
        assert robot("I", "--floor", "L1", "--at", "x").endswith("--at is 'x': not of the form X,Y or X,Y,HEADING")
        assert "there is no floor 'L9'" in robot("I", "--floor", "L9")
        assert robot("I", "--floor", "L1", "--at", "10,1").endswith("L1:10,1 is not free: a wall")
        assert "there is no adaptor 'hovering'" in robot("I", "--floor", "L1", "--adaptor", "hovering")


def test_nobody_there(system_orb: Orb) -> None:
    with pytest.raises(NotReachable, match="Robots/nobody is not reachable"):
        RemoteAgent(system_orb, "nobody", 0.3)
