"""A robot that avoids what it sees, as real processes: a chair that no map has is in its way, and it gets there."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentState, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from testkit.actual_robot import running_stand_in
from testkit.buildings import two_floors, with_all
from testkit.processes import eventually
from testkit.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.slow(60), pytest.mark.full]

#: It drives along a line [m] on which the middle of the chair is.
START, GOAL, CHAIR = (2.5, 3.0), (8.5, 3.0), (5.5, 3.0)
WHERE = ("--floor", "L1", "--at", f"{START[0]},{START[1]},0.0", "--perceive", "sensors")


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
            agent, states = robot.agent, list[AgentState]()
            agent.load(dumps(ProgramBuilder("there").mbase_path("L1", *GOAL).program()))
            agent.run()

            def has_ended() -> bool:
                states.append(agent.state())
                return states[-1].program.result is not ProgramResult.NO_RESULT

            eventually(has_ended, 240.0, "the end of the drive")
            report, at = states[-1].program, states[-1].at
            assert (report.result, report.reason) == (ProgramResult.DONE, ""), [state.at for state in states[-40:]]
            assert math.dist((at.x, at.y), GOAL) < 0.02
            assert max(abs(state.at.y - CHAIR[1]) for state in states) > 0.6
            servant = system_orb.resolve("Robots/S", RoboCorba.RobotAgent)
            (bumper,) = servant._get_sensors().readings()
            assert bumper.value == 0.0
