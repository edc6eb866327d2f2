"""The Python source of a program builds an equal program."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given

from robocorba.programs import program as programs
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.icons import Destination, Result
from robocorba.programs.program import Program
from robocorba.programs.python_source import python_source
from tests.programs.plain_programs import PROGRAMS


def built(source: str) -> Program:
    """The program that a source builds; it writes no file."""
    names: dict[str, Any] = {}
    *lines, write = source.splitlines()
    assert write.startswith("program.write(")
    exec("\n".join(lines), names)
    found: Program = names["program"].program()
    return found


@given(PROGRAMS)
def test_it_builds_an_equal_program(plain: dict[str, Any]) -> None:
    program = programs.loads(json.dumps(plain))
    assert built(python_source(program)) == program


def test_it_reads_like_a_program_of_a_person() -> None:
    fetch = ProgramBuilder("fetch").mhand_posture("both", "tuck")
    with fetch.repeat(2):
        fetch.mbase_path("L1", 1.0, 2.0, speed=0.5)
    with fetch.branch(Result("stopped")):
        fetch.say("a", {"b": [True, None]})
    with fetch.otherwise():
        fetch.move_table("desk", Destination("L1", 3.0, 2.0))
    assert python_source(fetch.program()) == "\n".join(
        [
            "from robocorba.programs.graphic_programming import ProgramBuilder",
            "from robocorba.programs.icons import Destination, Result",
            "",
            'program = ProgramBuilder("fetch")',
            'program.mhand_posture("both", "tuck")',
            "with program.repeat(2):",
            '    program.mbase_path("L1", 1.0, 2.0, speed=0.5)',
            'with program.branch(Result("stopped")):',
            '    program.say("a", payload={"b": [True, None]})',
            "with program.otherwise():",
            '    program.move_table("desk", Destination("L1", 3.0, 2.0))',
            'program.write("fetch.json")',
            "",
        ]
    )


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("a/../b", "a_.._b.json"),
        ("..", "program.json"),
        ("\u202eabc", "_abc.json"),
        ("x" * 200, "x" * 80 + ".json"),
        ("\U00020000" * 90, "\U00020000" * 20 + ".json"),
    ],
)
def test_the_name_of_its_file_is_harmless(name: str, file: str) -> None:
    source = python_source(ProgramBuilder(name).wait(1.0).program())
    assert source.splitlines()[-1] == f'program.write("{file}")'
    assert all(line.isprintable() for line in source.splitlines())
    assert Path(file).name == file
