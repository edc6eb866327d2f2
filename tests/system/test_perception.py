"""Robots that avoid what they see, as real processes: a chair that no map has is in their way, and they get there."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentState, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from testkit.actual_robot import running_stand_in
from testkit.buildings import two_floors, with_all
from testkit.heartbeats import heartbeats
from testkit.processes import eventually
from testkit.simulation import about
from testkit.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: Robots drive along a line [m] on which the middle of the chair is.
START, GOAL, CHAIR = (2.5, 3.0), (8.5, 3.0), (5.5, 3.0)
WHERE = ("--floor", "L1", "--at", f"{START[0]},{START[1]},0.0", "--perceive", "sensors")


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


def test_a_virtual_robot_drives_around_a_body_that_tells_nothing_and_straight_once_that_has_gone(
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
            drive(robot.agent, START)  # which shows it that the way is free
            free = drive(robot.agent, GOAL)
            assert max(abs(state.at.y - CHAIR[1]) for state in free) < 0.1
        assert server._get_state().collisions == 0
    finally:
        beats.close()


def test_an_actual_robot_drives_around_a_chair_that_no_map_has(system_orb: Orb, tmp_path: Path) -> None:
    """With its protective field, noise, and rays without an echo."""
    chair = MapObject(name="chair", shape=BoxShape(size=(0.5, 0.5)), at=CHAIR)
    native.save(with_all(two_floors(), [("L1", chair)]), tmp_path / "world.yaml")
    world = ("--world", str(tmp_path / "world.yaml"), "--world-at", *map(str, START), "0.0")
    noisy = ("--range-noise", "0.005", "--range-lost", "0.2")
    (tmp_path / "agent").mkdir()
    with running_stand_in(tmp_path / "robot", *world, *noisy, orb=system_orb) as actual:
        adaptor = (*WHERE, "--adaptor", "smartpal", "--", "--naming", str(actual.naming))
        with robot_process(tmp_path / "agent", system_orb, "S", *adaptor) as robot:
            states = drive(robot.agent, GOAL)
            assert max(abs(state.at.y - CHAIR[1]) for state in states) > 0.6
            servant = system_orb.resolve("Robots/S", RoboCorba.RobotAgent)
            (bumper,) = servant._get_sensors().readings()
            assert bumper.value == 0.0
