"""The bench of one program on two robots: ticks are read by icon, and compared at the same time within it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.robots import virtual_and_actual as bench
from robocorba.control.tick_file import Tick, TickFile
from robocorba.kinematics.body import SmartPalBody
from robocorba.kinematics.smartpal import JOINTS, Side
from robocorba.motion.robot_state import ActorCommand, RobotState
from robocorba.testing.virtual_and_actual import StateDifference

ICONS = ("icons[0]", "icons[2].icons[0]", "icons[3]")


def ticks(file: Path, moved_m: float = 0.0, turned_rad: float = 0.0, more: int = 0, hold: bool = False) -> None:
    """A robot that drives ahead icon by icon at 1 m/s, facing backwards. hold: with a tick of the icon that holds."""
    with TickFile(file) as made:
        for number, icon in enumerate(ICONS):
            if hold and "." in icon:
                made.add(tick("icons[2]", 1, 5.0, 1.0, 0.0, 0.0))
            for step in range(50):
                made.add(tick(icon, number, 10.0 * number + step / 50, number + step / 50, moved_m, turned_rad))
            for step in range(50, 50 + more):
                made.add(tick(icon, number, 10.0 * number + step / 50, number + 49 / 50, moved_m, turned_rad))


def tick(icon: str, done: int, time: float, x: float, y: float, turned_rad: float) -> Tick:
    joints = np.zeros(len(JOINTS))
    heading = np.pi - 0.01 + turned_rad
    state = RobotState(time, x, y, heading if heading < np.pi else heading - 2 * np.pi, joints=joints)
    return Tick("simulated", "p", icon, done, "L1", state, ActorCommand(joints=joints))


def test_ticks_are_compared_icon_by_icon(tmp_path: Path) -> None:
    ticks(tmp_path / "virtual.csv", hold=True)
    ticks(tmp_path / "actual.csv", 0.003, 0.02, more=5)
    virtual, actual = (bench.parts_of(tmp_path / f"{name}.csv") for name in ("virtual", "actual"))
    assert [part.icon for part in virtual] == [part.icon for part in actual] == list(ICONS)
    found = bench.compared(1, virtual, actual, SmartPalBody())
    assert len(found) == 3 * 55
    assert {row["base_mm"] for row in found} == {3.0}
    assert {row["turned_deg"] for row in found} == {round(np.degrees(0.02), 4)}
    assert found[-1]["program_s"] == pytest.approx(3 * 54 / 50)
    table = bench.rows(found, [(virtual, actual)], [StateDifference(0.004, 0.001, dict.fromkeys(Side, 0.002))])
    assert [row["icon"] for row in table] == [*("[0] mhand_posture", "[2][0] mbase_by", "[3] gripper", "at the end")]
    assert (table[0]["s virtual"], table[0]["s actual"]) == pytest.approx((0.98, 1.08))
    assert table[-1]["base most"] == pytest.approx(4.0)


@pytest.mark.parametrize(("base_m", "is_reached"), [(0.009, True), (0.011, False)])
def test_marks(base_m: float, is_reached: bool) -> None:
    found = bench.marks(
        [
            StateDifference(0.001, 0.001, dict.fromkeys(Side, 0.001)),
            StateDifference(base_m, 0.0, dict.fromkeys(Side, 0.0)),
        ]
    )
    assert all(mark.is_reached for mark in found) == is_reached
