"""Options that have no effect beside others, or without them, are refused instead of ignored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.maps import native
from robocorba.testing.buildings import two_floors
from tests.formats.ros_files import WHITE, write_ros

#: A command, the option that is refused, and what it is for.
WITHOUT_EFFECT = [
    ("map import two.yaml new.yaml --radius 0.3", "--radius", "--topology"),
    ("map import two.yaml new.yaml --unknown free", "--unknown", "ROS maps"),
    ("map import two.yaml new.yaml --specks all", "--specks", "ROS maps"),
    ("map export two.yaml new.yaml -f native --resolution 0.1", "--resolution", "--format ros"),
    ("map export two.yaml new.yaml -f openrmf --image png", "--image", "--format ros"),
    ("watch --seconds 5", "--seconds", "--video"),
    ("watch --once --fps 5", "--fps", "--video"),
    ("watch --json --width 500", "--width", "--video"),
    ("watch --video new.mp4 --once", "--once", "tables"),
    ("watch --video new.mp4 --json", "--json", "tables"),
    ("replay old.mcap --at 5 --video new.mp4", "--at", "tables and --png"),
    ("replay old.mcap --at 5 --speed 2", "--speed", "--video and tables without --at"),
    ("replay old.mcap --png new.png --speed 2", "--speed", "--video and tables without --at"),
    ("replay old.mcap --png new.png --fps 5", "--fps", "--video"),
    ("replay old.mcap --width 500", "--width", "--png and --video"),
    ("convert old.mcap new.mcap --robots A", "--robots", "--ros2"),
    ("convert old.mcap new.mcap --namespaced-tf", "--namespaced-tf", "--ros2"),
    ("mission status --leader A --json", "--json", "a mission by its name"),
    ("up --console-port 9000", "--console-port", "--console"),
    ("up --hang-limit 0 --spare-stopped", "--spare-stopped", "a --hang-limit above 0"),
    ("robots fleet.yaml --prefix Q", "--prefix", "robots of --count, a file has its own"),
    ("robots fleet.yaml --floor L1", "--floor", "robots of --count, a file has its own"),
    ("stop --all --reset --state here", "--state", "a stop without --reset"),
    ("foxglove --state here", "--state", "--steer"),
]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    native.save(two_floors(), "two.yaml")


@pytest.mark.parametrize(("typed", "option", "purpose"), WITHOUT_EFFECT)
def test_an_option_without_effect_is_refused(typed: str, option: str, purpose: str) -> None:
    result = CliRunner().invoke(command(), typed.split(), env={"COLUMNS": "200", "NO_COLOR": "1"})
    assert result.exit_code == 2, result.output
    assert f"Invalid value for '{option}'" in result.output
    assert f"it has no effect, it is for {purpose}" in result.output
    assert {path.name for path in Path().iterdir()} == {"two.yaml"}


@pytest.mark.parametrize(
    "typed",
    [
        "map import ros.yaml new.yaml --unknown free --specks all --topology --radius 0.3",
        "map export two.yaml new.yaml -f ros --resolution 0.1 --image png",
    ],
)
def test_options_that_have_an_effect_are_accepted(typed: str) -> None:
    write_ros(Path(), np.full((20, 20), WHITE), "ros")
    result = CliRunner().invoke(command(), typed.split())
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("typed", "code", "reason"),
    [
        ("map show two.yaml --width 100", 2, "'--width'"),
        ("simulation limit 5000000000", 2, "robots"),
        ("simulation step 20000", 2, "steps"),
        ("path L1:1,1 L1:2,2 --alternatives -1", 2, "'--alternatives'"),
        ("watch --video new.mp4 --width 5000000000", 2, "'--width'"),
        ("mission start move-table --table box --to L1:nan,1", 1, "'L1:nan,1' is not of the form FLOOR:X,Y"),
        ("mission start move-table --table box --to L1:1,1,inf", 1, "'L1:1,1,inf' is not of the form FLOOR:X,Y"),
    ],
)
def test_values_beyond_their_limits_are_refused_before_anything_is_called(typed: str, code: int, reason: str) -> None:
    result = CliRunner().invoke(command(), typed.split(), env={"COLUMNS": "200", "NO_COLOR": "1"})
    assert (result.exit_code, reason.lower() in result.output.lower()) == (code, True), result.output
