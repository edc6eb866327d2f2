"""Two robot processes that meet at a landing: one leaves the cabin for which the other waits."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from robocorba.map_editor import native
from robocorba.map_editor.samples import load_sample
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.processes import eventually, running_system
from testkit.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: Before E2 of five-floors, on either floor.
STARTS = {"A": ("L1", 17.0, 8.0), "B": ("L2", 17.0, 9.0)}


def test_a_robot_leaves_a_cabin_straight_towards_another_that_waits_for_it(tmp_path: Path) -> None:
    native.save(load_sample("five-floors"), tmp_path / "building.yaml")
    with (
        running_system(tmp_path, "--building", str(tmp_path / "building.yaml")) as (running, _),
        Orb(running.naming) as orb,
        contextlib.ExitStack() as robots,
    ):
        agents = {
            name: robots.enter_context(
                robot_process(tmp_path, orb, name, "--floor", floor, "--at", f"{x},{y},1.57")
            ).agent
            for name, (floor, x, y) in STARTS.items()
        }
        for name, other in (("A", "B"), ("B", "A")):
            agents[name].load(dumps(ProgramBuilder("change floors").mbase_path(*STARTS[other]).program()))
            agents[name].run()
        for name, agent in agents.items():
            eventually(lambda agent=agent: agent.state().program.result is not ProgramResult.NO_RESULT, 300.0, name)
            assert agent.state().program.result is ProgramResult.DONE, agent.state().program
