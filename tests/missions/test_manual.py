"""docs/mission.md: its tables of messages and steps, and its program."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from robocorba.missions.messages import KINDS, MemberMeasurements
from robocorba.missions.subplan import Idle, Step, SubPlan
from robocorba.robot.programs import icons
from robocorba.robot.programs.program import loads

DOCS = Path(__file__).resolve().parents[2] / "docs"
MANUAL = (DOCS / "mission.md").read_text()
(PROGRAM,) = re.findall(r"```python\n(.*?)```", MANUAL, re.DOTALL)


def rows(start: str) -> dict[str, set[str]]:
    """The words in code of each row of a table, by the first one of the row."""
    found = (re.findall(r"`([^`]+)`", line) for line in MANUAL.splitlines() if line.startswith(start))
    return {words[0]: {word for each in words[1:] for word in re.findall(r"\w+", each)} for words in found if words}


def test_all_members_of_messages_and_all_steps_are_documented() -> None:
    documented = rows("| `mission.")
    assert documented.keys() == KINDS.keys()
    for name, kind in KINDS.items():
        wanted = {field.encode_name for field in msgspec.structs.fields(kind)} - {"mission", "sent"}
        if name == "mission.proposal":
            wanted |= {field.encode_name for field in msgspec.structs.fields(SubPlan)}
        assert wanted <= documented[name], name
    for field in msgspec.structs.fields(MemberMeasurements):
        assert f"`{field.encode_name}`" in MANUAL
    documented = {name.split()[0] for name in rows("| `")}
    assert {kind.__name__ for kind in (*get_args(Step), Idle)} <= documented


def test_the_program_of_the_manual_is_valid(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(PROGRAM, "docs/mission.md", "exec"), {})
    program = loads(capsys.readouterr().out)
    assert [type(icon) for icon in program.icons if isinstance(icon, icons.MoveTable | icons.HandOver)] == [
        *(icons.MoveTable, icons.HandOver)
    ]
