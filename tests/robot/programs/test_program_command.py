"""robocorba program: check, show, schema, with what they print and their exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robocorba.commands.program import app
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Holding
from robocorba.robot.programs.program import schema


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fetch = ProgramBuilder("fetch").mhand_posture("both", "ready").mbase_path("L3", 21.25, 5.0)
    with fetch.branch(Holding("left")):
        fetch.say("got [it]", {"n": 1})
    with fetch.otherwise():
        fetch.wait(1)
    fetch.write("fetch.json")
    far = ProgramBuilder("far").wait(1).mhand_pose("left", 2, 0, 1).mbase_path("L9", 1, 1)
    far.write("far.json")
    Path("odd.json").write_text('{"name": "odd", "icons": [{"icon": "wait", "seconds": -1}]}')


def robocorba_program(*arguments: str, input: str | None = None) -> Result:
    result = CliRunner().invoke(app, list(arguments), input=input)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.output
    return result


def test_check_says_what_is_wrong_and_what_was_not_checked() -> None:
    result = robocorba_program("check", "fetch.json")
    assert result.exit_code == 0
    assert "note: no map: the base is not checked" in result.output
    assert result.output.splitlines()[-1] == "fetch.json is valid: 5 icons"
    result = robocorba_program("check", "fetch.json", "--building", "five-floors", "--at", "L1:17,4")
    assert result.exit_code == 0
    assert "no map" not in result.output
    result = robocorba_program("check", "fetch.json", "--building", "paper-scene", "--at", "L1:1.1,3.3")
    assert result.exit_code == 1
    assert "fetch.json: icons[1].floor: goal: there is no floor 'L3'" in result.output
    result = robocorba_program("check", "far.json", "--building", "five-floors", "--at", "L1:17,4")
    assert result.exit_code == 1
    told = [line for line in result.output.splitlines() if line.startswith("far.json: ")]
    assert [line.split(": ")[1] for line in told] == ["icons[1].x, y, z", "icons[2].floor"]


@pytest.mark.parametrize("command", ["check", "show"])
def test_a_file_that_is_no_program(command: str) -> None:
    result = robocorba_program(command, "odd.json")
    assert result.exit_code == 1
    assert "odd.json: icons[0].seconds: expected float > 0.0" in result.output
    result = robocorba_program(command, "none.json")
    assert result.exit_code == 1
    assert f"robocorba program {command}: none.json: No such file" in result.output


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--at", "L1"), "FLOOR:X,Y"),
        (("--building", "none.yaml"), "none.yaml"),
        (("--naming", "127.0.0.1:1", "--building", "five-floors"), "only one of"),
    ],
)
def test_options_that_can_not_be(arguments: tuple[str, ...], reason: str) -> None:
    result = robocorba_program("check", "fetch.json", *arguments)
    assert result.exit_code != 0
    assert reason in result.output


def test_show_prints_every_icon_with_its_parameters() -> None:
    lines = robocorba_program("show", "fetch.json").output.splitlines()
    assert lines[0] == "fetch (SmartPal)"
    assert "icons[0] mhand_posture hand=both posture=ready" in lines[1]
    assert "icons[1] mbase_path floor=L3 x=21.25 y=5" in lines[2]
    assert 'icons[2] branch condition={"when":"holding","hand":"left"}' in lines[3]
    assert "then" in lines[4] and 'then[0] say type=got [it] payload={"n":1}' in lines[5]
    assert "otherwise" in lines[6] and "otherwise[0] wait seconds=1" in lines[7]


def test_the_standard_input_is_a_file_too_and_schema_prints_the_schema() -> None:
    assert robocorba_program("show", "-", input=Path("fetch.json").read_text()).exit_code == 0
    assert "-: not JSON" in robocorba_program("show", "-", input="nonsense").output
    assert json.loads(robocorba_program("schema").output) == schema()
