"""Every icon is known to all parts that have to know it: what runs, checks, builds and shows programs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, create_autospec

import msgspec
import pytest

import robocorba
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs import icons
from robocorba.robot.programs.checker import check
from robocorba.robot.programs.icons import ICONS, CooperativeIcon, Icon, bodies
from robocorba.robot.programs.program import Program, of_icon
from robocorba.robot.robot import Robot
from robocorba.robot.runner import Runner
from testkit.fuzzing import examples

UNSUPPORTED = "unsupported icon type"
OWN = sorted(name for name, kind in ICONS.items() if kind not in icons.INSTALLED)
EXAMPLES = {each["icon"]: each for each in (*examples.ICONS, *examples.MISSIONS) if each.get("then", True)}
LOOKS = (Path(robocorba.__file__).parent / "console" / "static" / "icon_looks.js").read_text()
MANUAL = (Path(__file__).parents[3] / "docs" / "programs.md").read_text()


class Jump(type(icons.Wait(1.0)).__mro__[1], frozen=True):  # type: ignore[misc]
    """An icon that nobody knows."""


def example(name: str) -> Icon:
    return msgspec.convert(EXAMPLES[name], ICONS[name])


def block(name: str) -> str:
    """The value of a constant of icon_looks.js."""
    found = re.search(rf"^const {name} = [{{[]\n(.*?)^[}}\]];", LOOKS, re.DOTALL | re.MULTILINE)
    assert found, f"icon_looks.js has no {name}"
    return found[1]


@pytest.mark.parametrize("name", OWN)
def test_every_icon_is_known_everywhere(name: str) -> None:
    assert name in EXAMPLES, "testkit/fuzzing/examples.py lacks it"
    icon = example(name)
    report = check(Program(name="a", icons=(icon,)))
    assert not [finding for finding in report.findings if UNSUPPORTED in finding.reason]
    lists = [key for key, value in EXAMPLES[name].items() if isinstance(value, list) and _are_icons(value)]
    assert [parameter for parameter, _ in bodies(icon)] == lists
    assert re.search(rf'^  {name}: \["\w+", "[^"]+"\],$', block("LOOKS"), re.MULTILINE)
    assert f'"{name}"' in block("GROUPS")
    assert re.search(rf"^  {name}: \(v\) =>", block("SUMMARIES"), re.MULTILINE)
    assert re.search(rf"^\| `{name}` \|.*\| \S.* \|$", MANUAL, re.MULTILINE)
    if issubclass(ICONS[name], CooperativeIcon):
        assert of_icon(msgspec.json.encode(icon).decode()).icons == (icon,)
    else:
        assert name in {each["icon"] for each in examples.ICONS}


@pytest.mark.parametrize("name", OWN)
def test_every_icon_is_run(name: str) -> None:
    robot = create_autospec(Robot, instance=True)
    robot.joints, robot.kinematics = [0.0] * len(JOINTS), InverseKinematics()
    robot.execution, robot.holds.return_value, robot.nearest_m.return_value = MagicMock(), True, 1.0
    others = MagicMock()
    report = Runner(Program(name="a", icons=(example(name),)), robot, others).run()
    assert (report.result.name, report.reason) == ("DONE", "")
    calls = robot.mock_calls + others.mock_calls
    assert [each for each in calls if "subscribe" not in each[0]], "it does nothing"


@pytest.mark.parametrize("name", sorted(icons.CONDITIONS))
def test_every_condition_has_words(name: str) -> None:
    assert re.search(rf"^  {name}: \(c\) =>", block("CONDITIONS"), re.MULTILINE)


@pytest.mark.parametrize("icon", [Jump(), icons.Repeat(2, (Jump(),))])
def test_an_icon_that_nobody_knows_is_refused_before_it_runs(icon: Any) -> None:
    (finding,) = check(Program(name="a", icons=(icon,))).findings
    assert (finding.parameter, finding.reason) == ("icon", f"{UNSUPPORTED} jump")


def _are_icons(value: list[Any]) -> bool:
    return all(isinstance(each, dict) and "icon" in each for each in value)
