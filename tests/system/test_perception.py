"""Robots and what they see, as real processes: a chair that no map has is in their way, and they get there, or a
program stops them before it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Result
from robocorba.robot.programs.program import Program, dumps
from robocorba.stubs import RoboCorba
from testkit.actual_robot import StandIn, running_stand_in
from testkit.buildings import two_floors, with_all
from testkit.heartbeats import heartbeats
from testkit.processes import eventually
from testkit.simulation import about
from testkit.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: Robots drive along a line [m] on which the middle of the chair is.
START, GOAL, CHAIR = (2.5, 3.0), (8.5, 3.0), (5.5, 3.0)
WHERE = ("--floor", "L1", "--at", f"{START[0]},{START[1]},0.0", "--perceive", "sensors")
#: At what distance the laser stops a robot, and how much nearer it comes at most [m]: at 0.15 m/s, a distance may be
#: late by half a second on a busy machine, and then it slows down.
STOP_M, LATE_M = 1.0, 0.1


def drive(agent: RemoteAgent, goal: tuple[float, float]) -> list[AgentState]:
    """States on the way to a goal, which it reaches."""
    agent.load(dumps(ProgramBuilder("there").mbase_path("L1", *goal).program()))
    agent.run()
    states: list[AgentState] = []

    def has_ended() -> bool:
        states.append(agent.state())
        return states[-1].program.result is not ProgramResult.NO_RESULT

    eventually(has_ended, 240.0, "the end of the drive")
    last = states[-1]
    assert (last.program.result, last.program.reason) == (ProgramResult.DONE, "")
    assert math.dist((last.at.x, last.at.y), goal) < 0.02
    return states


def test_a_virtual_robot_drives_around_a_body_that_tells_nothing_and_back_once_that_has_gone(
    system_orb: Orb, tmp_path: Path
) -> None:
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    chair = server.registerRobot(about("chair", *CHAIR, radius=0.25))
    beats = heartbeats(lambda: [chair])
    try:
        with robot_process(tmp_path, system_orb, "V", *WHERE) as robot:
            states = drive(robot.agent, GOAL)
            assert max(abs(state.at.y - CHAIR[1]) for state in states) > 0.6
            chair.deregister()
            back = drive(robot.agent, START)
            assert max(abs(state.at.y - CHAIR[1]) for state in back) < max(
                abs(state.at.y - CHAIR[1]) for state in states
            )
        assert server._get_state().collisions == 0
    finally:
        beats.close()


@pytest.fixture
def stand_in(system_orb: Orb, tmp_path: Path) -> Iterator[StandIn]:
    """An actual robot in the same building, where somebody has left a chair; with noise, and rays without an echo."""
    chair = MapObject(name="chair", shape=BoxShape(size=(0.5, 0.5)), at=CHAIR)
    native.save(with_all(two_floors(), [("L1", chair)]), tmp_path / "world.yaml")
    world = ("--world", str(tmp_path / "world.yaml"), "--world-at", *map(str, START), "0.0")
    noisy = ("--range-noise", "0.005", "--range-lost", "0.2")
    with running_stand_in(tmp_path / "robot", *world, *noisy, orb=system_orb) as found:
        yield found


def contacts(orb: Orb) -> float:
    """That the bumper of S has counted."""
    (bumper,) = orb.resolve("Robots/S", RoboCorba.RobotAgent)._get_sensors().readings()
    assert (bumper.name, bumper.unit) == ("bumper", "contacts")
    return float(bumper.value)


def test_an_actual_robot_drives_around_a_chair_that_no_map_has(
    system_orb: Orb, stand_in: StandIn, tmp_path: Path
) -> None:
    """With its protective field."""
    adaptor = (*WHERE, "--adaptor", "smartpal", "--", "--naming", str(stand_in.naming))
    with robot_process(tmp_path, system_orb, "S", *adaptor) as robot:
        states = drive(robot.agent, GOAL)
        assert max(abs(state.at.y - CHAIR[1]) for state in states) > 0.6
        assert contacts(system_orb) == 0.0


def run(agent: RemoteAgent, program: Program, *conditions: AgentCondition) -> AgentState:
    """To its end; the robot is then in one of the conditions."""
    agent.load(dumps(program))
    agent.run()

    def state() -> AgentState | None:
        found = agent.state()
        has_ended = found.program.result is not ProgramResult.NO_RESULT
        return found if has_ended and found.condition in (conditions or (AgentCondition.IDLE,)) else None

    found: AgentState = eventually(state, 60.0, "the program's end")
    return found


def test_the_laser_of_an_actual_robot_stops_it_before_the_chair(
    system_orb: Orb, stand_in: StandIn, tmp_path: Path
) -> None:
    """Driven on without a look, it runs into the chair, and its bumper says so."""
    watched = ProgramBuilder("watched")
    with watched.stop_if_closer("laser", STOP_M):
        watched.mbase_by(ahead=3.0, speed=0.15)
    with watched.branch(Result("stopped")):
        watched.wait(0.1)
    hitting = ProgramBuilder("blind").mbase_by(ahead=2.0, speed=0.15).program()
    adaptor = (*WHERE[:4], "--protect", "off", "--adaptor", "smartpal", "--", "--naming", str(stand_in.naming))
    with robot_process(tmp_path, system_orb, "S", *adaptor) as robot:
        state = run(robot.agent, watched.program())
        assert (state.program.result, state.program.reason) == (ProgramResult.DONE, "")
        assert [icon.kind for icon in robot.agent.begun(0)][-1] == "wait"
        stopped_at = CHAIR[0] - 0.25 - STOP_M
        assert stopped_at - 0.05 < state.at.x < stopped_at + LATE_M
        hit = run(robot.agent, hitting, AgentCondition.STOPPED)
        assert "Mobility" in hit.reason
        assert hit.actor.x == pytest.approx(CHAIR[0] - 0.25 - 0.4, abs=0.03)
        assert contacts(system_orb) == 1.0
        robot.agent.reset_stop()
        assert (
            run(robot.agent, ProgramBuilder("back").mbase_by(ahead=-0.2).program()).program.result is ProgramResult.DONE
        )
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    assert server._get_state().collisions == 0  # its body in the building met nothing
