"""Cooperative icons and planners of other packages."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.clients.cooperative_planners import planner_of
from robocorba.errors.robots import MissionFailed
from robocorba.robot.programs.icons import CooperativeIcon, kind
from robocorba.robot.programs.installed_icons import installed

ICONS = """
from robocorba.robot.programs.icons import CooperativeIcon, Text

class Wave(CooperativeIcon, frozen=True):
    guest: Text

class MoveTable(CooperativeIcon, frozen=True):
    pass

class Other:
    pass
"""
ENTRIES = """
[robocorba.cooperative_icons]
wave = waving_icons:Wave
taken = waving_icons:MoveTable
no_icon = waving_icons:Other
missing = no_such_module:Icon

[robocorba.cooperative_planners]
wave = waving_icons:Wave
bow = no_such_module:planner
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that is installed."""
    (tmp_path / "waving_icons.py").write_text(ICONS)
    metadata = tmp_path / "waving-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: waving\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(tmp_path)


def test_a_package_adds_an_icon_and_what_is_wrong_is_left_out(package: None, caplog: pytest.LogCaptureFixture) -> None:
    found = installed(CooperativeIcon, {"move_table"})
    assert [icon.__struct_config__.tag for icon in found] == ["wave"]
    warnings = [record.getMessage() for record in caplog.records]
    assert [message.split(" is left out: ")[0].split()[-1] for message in warnings] == ["missing", "no_icon", "taken"]
    assert "there is an icon move_table already" in warnings[-1]


class Bow(CooperativeIcon, frozen=True):
    """An icon whose planner can't be loaded."""


class Lost(CooperativeIcon, frozen=True):
    """An icon without a planner."""


def test_planners_of_packages(package: None) -> None:
    (wave,) = installed(CooperativeIcon, {"move_table"})
    assert planner_of(wave(guest="B")) is wave  # type: ignore[arg-type, call-arg]
    with pytest.raises(MissionFailed, match="the planner of bow can't be loaded: ModuleNotFoundError"):
        planner_of(Bow())  # type: ignore[arg-type]
    with pytest.raises(MissionFailed, match="there is no planner for the cooperative icon lost"):
        planner_of(Lost())  # type: ignore[arg-type]
    assert kind(Bow()) == "bow"  # type: ignore[arg-type]
