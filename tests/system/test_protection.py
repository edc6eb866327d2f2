"""The protective field of robot processes: missions of protected robots, and an unmapped thing before an actual one."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.missions import FLOOR, RobotStart, missions, three_rooms
from testkit.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

CREW = {
    "A": RobotStart(0.7, 1.0, 0.0, "lab"),
    "B": RobotStart(4.6, 3.6, math.pi, "lab"),
    "C": RobotStart(5.2, 1.0, math.pi, "hall"),
}


def test_three_protected_robots_carry_a_table_and_none_drives_into_a_wall(tmp_path: Path) -> None:
    with missions(tmp_path, three_rooms()) as place:
        place.start(CREW, "--protect", "on")
        code, out, err = place.outcome(place.mission("A", "table", f"{FLOOR}:3.8,2.6"))
        assert code == 0, out + err
        assert math.dist(place.body("table")[:2], (3.8, 2.6)) < 0.05
        assert place.collisions == 0
        agent = place.agent("B")
        eventually(lambda: place.is_free("B"), 60.0, "B is free")
        eventually(lambda: place.is_free("A"), 60.0, "A is free")
        starts = {name: place.body(name)[:2] for name in "AB"}
        for name, other in (("A", "B"), ("B", "A")):  # each drives to where the other one is
            swap = ProgramBuilder("swap").mbase_path(FLOOR, *starts[other])
            place.agent(name).load(dumps(swap.program()))
        for name in "AB":
            place.agent(name).run()
        for name in "AB":
            gets = eventually(lambda name=name: place.agent(name).state().program.result.value, 240.0, name)
            assert gets == ProgramResult.DONE.value, place.agent(name).state().program
        assert place.collisions == 0
        agent.load(dumps(ProgramBuilder("into the wall").mbase_velocity(0.0, 0.38, 0.0, 60.0).program()))
        agent.run()
        ended = eventually(
            lambda: (now := agent.state().program).result is not ProgramResult.NO_RESULT and now, 120.0, ""
        )
        assert ended.result is ProgramResult.FAILED
        assert "sees something 0.0" in ended.reason
        assert place.collisions == 0
