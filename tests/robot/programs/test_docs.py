"""docs/programs.md: its vocabulary is the code's, its example runs and its file is one."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest

from robocorba.robot.kinematics.tasks import POSTURES
from robocorba.robot.programs.icons import CONDITIONS, ICONS, Sensor
from robocorba.robot.programs.program import dumps, load, loads
from tests.robot.programs import json_schema
from tests.robot.programs.plain_programs import SCHEMA

DOC = (Path(__file__).parents[3] / "docs" / "programs.md").read_text()


def vocabulary(kinds: dict[str, Any], tag: str) -> str:
    """The table of icons or conditions: parameters with units, those that may be left out in brackets."""
    rows = [f"| `{tag}` | parameters | what |", "|---|---|---|"]
    for name, kind in kinds.items():
        node = SCHEMA["$defs"][kind.__name__]
        words = []
        for parameter, part in node["properties"].items():
            if parameter != tag:
                ways = [way for way in part.get("anyOf", [part]) if way.get("type") != "null"]
                unit = re.search(r" \[(.*)\]", ways[0].get("title", "") if len(ways) == 1 else "")
                word = f"`{parameter}`" + (f" {unit[1]}" if unit else "")
                words.append(word if parameter in node["required"] else f"[{word}]")
        rows.append(f"| `{name}` | {', '.join(words)} | {node['description']} |")
    return "\n".join(rows)


@pytest.mark.parametrize(("kinds", "tag"), [(ICONS, "icon"), (CONDITIONS, "when")])
def test_the_tables_tell_what_the_code_does(kinds: dict[str, Any], tag: str) -> None:
    wanted = vocabulary(kinds, tag)
    assert wanted in DOC, f"docs/programs.md needs this table:\n{wanted}"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", DOC, re.DOTALL)


def test_every_sensor_and_posture_is_named_and_the_file_is_a_program() -> None:
    for name in (*get_args(Sensor), *POSTURES):
        assert f"`{name}`" in DOC
    (text,) = blocks("json")
    assert loads(dumps(loads(text))) == loads(text)
    assert json_schema.problems(SCHEMA, json.loads(text)) == []


def test_the_python_in_the_manual_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    make, check = blocks("python")
    assert len(make[make.index("fetch =") :].splitlines()) == 9
    namespace: dict[str, Any] = {}
    exec(make, namespace)
    (text,) = blocks("json")
    assert load("fetch.json") == loads(text)
    exec(check, namespace)
    assert namespace["report"].is_valid
