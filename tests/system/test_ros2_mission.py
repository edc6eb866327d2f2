"""A robot that speaks ROS 2 and has no arms, beside a mission of robots that have them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from testkit.missions import RobotStart, missions, three_rooms
from testkit.processes import Launcher, eventually
from testkit.ros2_disc import Disc
from testkit.ros2_environment import ros2_python

pytestmark = [pytest.mark.system, pytest.mark.slow(70), pytest.mark.full]

PYTHON = ros2_python()
if not PYTHON:
    pytest.skip("ROS 2 is not installed; see make ros2", allow_module_level=True)
GOAL = (3.8, 7.6)


def test_a_robot_without_arms_makes_way_for_a_mission_and_does_not_lead_it(
    launch: Launcher, domain: int, tmp_path: Path
) -> None:
    """Though it is the nearest one, and stands at the goal."""
    disc = Disc(launch, PYTHON, tmp_path, domain, "30.0")
    within = ("env", *(f"{name}={value}" for name, value in disc.environment.items()), PYTHON)
    with missions(tmp_path, three_rooms()) as place:
        place.start(
            {
                "A": RobotStart(0.7, 6.2, 0.0, "lab"),
                "B": RobotStart(5.2, 6.0, math.pi, "hall"),
                "D": RobotStart(*GOAL, 0.0, "lab", Disc.ADAPTOR, within),
            }
        )
        code, out, err = place.outcome(place.mission("", "desk", f"L1:{GOAL[0]},{GOAL[1]}"))
        assert code == 0 and out.splitlines()[-1].startswith("done\t"), err
        assert place.body("desk")[:2] == pytest.approx(GOAL, abs=0.05)
        assert math.dist(disc.where[-1][:2], (0.0, 0.0)) > 0.5
        eventually(lambda: place.is_free("D"), what="D is free")
