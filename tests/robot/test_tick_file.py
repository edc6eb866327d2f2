"""Ticks in a file: all of them, no more than there may be, and nobody waits for the disk."""

from __future__ import annotations

import csv
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.files import OutputError
from robocorba.robot import tick_file
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.tick_file import COLUMNS, TickFile

JOINTS_RAD = np.arange(len(JOINTS)) / 10.0
DURING = ("simulated", "fetch, carry", "icons[1].icons[0]", 3, "L1")


def tick(number: int) -> Any:
    state = RobotState(number / 50.0, 1.0, -2.0, 0.5, (0.1, 0.2, 0.3), JOINTS_RAD, np.zeros(len(JOINTS)))
    command = ActorCommand((0.4, 0.5, 0.6), JOINTS_RAD + 1.0, np.zeros(len(JOINTS)))
    return DURING, state, command


def rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def test_every_tick_is_written(tmp_path: Path) -> None:
    file = tmp_path / "ticks.csv"
    with closing(TickFile(file)) as ticks:
        for number in range(100):
            ticks.add(*tick(number))
    found = rows(file)
    assert tuple(found[0]) == COLUMNS
    assert [float(row["time"]) for row in found] == [number / 50.0 for number in range(100)]
    row = found[7]
    assert list(row.values())[:5] == ["simulated", "fetch, carry", "icons[1].icons[0]", "3", "L1"]
    assert [float(row[name]) for name in COLUMNS[6:15]] == [1.0, -2.0, 0.5, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert [float(row[name]) for name in JOINTS] == pytest.approx(JOINTS_RAD)
    assert [float(row[f"told_{name}"]) for name in JOINTS] == pytest.approx(JOINTS_RAD + 1.0)


def test_a_slow_disk_delays_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk, made = threading.Event(), tick_file._row

    def slow(*one: Any) -> Any:
        assert disk.wait(60.0)
        return made(*one)

    monkeypatch.setattr(tick_file, "_row", slow)
    with closing(TickFile(tmp_path / "ticks.csv")) as ticks:
        for number in range(tick_file.MAX_QUEUED + 50):
            ticks.add(*tick(number))
        assert ticks.dropped >= 49
        disk.set()
    assert len(rows(tmp_path / "ticks.csv")) == tick_file.MAX_QUEUED + 50 - ticks.dropped


def test_a_robot_without_joints_and_a_file_that_has_a_bound(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "ticks.csv"
    with closing(TickFile(file, max_ticks=10)) as ticks:
        for _ in range(15):
            ticks.add(DURING, RobotState(), ActorCommand())
    assert len(rows(file)) == 10
    assert {row[name] for row in rows(file) for name in JOINTS} == {""}
    assert {row["told_turn"] for row in rows(file)} == {"0.000000"}
    assert "lacks 5 ticks" in caplog.text


def test_files_that_can_t_be_written(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A record replaces an earlier one, and no other file."""
    with pytest.raises(RoboCorbaError, match=r"can't create .*nowhere/ticks\.csv: No such file"):
        TickFile(tmp_path / "nowhere" / "ticks.csv")
    with closing(TickFile(Path("/dev/full"))) as ticks:
        ticks.add(*tick(0))
        ticks._thread.join(60.0)
        ticks.add(*tick(1))
    assert "stopped recording to /dev/full: " in caplog.text
    file = tmp_path / "a.csv"
    for _ in range(2):
        TickFile(file).close()
    assert file.read_text().startswith("adaptor,program,")
    file.write_text("mine")
    with pytest.raises(OutputError, match=r"a\.csv: exists already"):
        TickFile(file)
    assert file.read_text() == "mine"
