"""Programs: read, written, made in Python; every malformed one refused with icon and parameter."""

from __future__ import annotations

import json
import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from robocorba.errors.robots import InvalidProgram
from robocorba.map_editor.samples import load_sample
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.programs.checker import Start, check
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Destination, HandOver, Result, Wait, kind
from robocorba.robot.programs.program import (
    MAX_BYTES,
    MAX_ICONS,
    MAX_NESTING,
    Program,
    dumps,
    icons_with_paths,
    load,
    loads,
    of_icon,
)
from robocorba.robot.programs.python_source import python_source
from tests.robot.programs import json_schema
from tests.robot.programs.plain_programs import PROGRAMS, SCHEMA, Malformed, malformed, plain_icons

UNHURRIED = settings(deadline=None, suppress_health_check=list(HealthCheck))
WAIT: dict[str, Any] = {"icon": "wait", "seconds": 1}
HAND_OVER = json.dumps({"icon": "hand_over", "object": "cup", "taker": "B"})


def built(source: str) -> Program:
    """The program that a Python source builds; it writes no file."""
    names: dict[str, Any] = {}
    *lines, write = source.splitlines()
    assert write.startswith("program.write(")
    exec("\n".join(lines), names)
    found: Program = names["program"].program()
    return found


@settings(UNHURRIED, max_examples=50)
@given(PROGRAMS)
def test_what_the_schema_accepts_is_read_and_written_the_same(plain: dict[str, Any]) -> None:
    program = loads(json.dumps(plain))
    written = dumps(program)
    assert loads(written) == program
    assert json_schema.problems(SCHEMA, json.loads(written)) == []
    paths = [(path, kind(icon)) for path, icon in icons_with_paths(program)]
    assert paths == [(path, icon["icon"]) for path, icon in plain_icons(plain)]
    assert built(python_source(program)) == program


@settings(UNHURRIED, max_examples=60)
@given(malformed())
def test_malformed_programs_are_refused_with_icon_and_parameter(wrong: Malformed) -> None:
    icon, parameter, reason = refusal(wrong.text)
    assert icon == wrong.icon
    assert parameter == wrong.parameter or parameter.startswith((f"{wrong.parameter}[", f"{wrong.parameter}."))
    assert reason


def refusal(text: str | bytes) -> tuple[str, str, str]:
    with pytest.raises(InvalidProgram) as refused:
        loads(text)
    assert str(refused.value).encode()  # it can be sent
    return refused.value.icon, refused.value.parameter, refused.value.reason


@pytest.mark.parametrize(
    ("text", "icon", "parameter", "reason"),
    [
        (b"\xff\xfe", "", "", "not UTF-8"),
        ("", "", "", "not JSON"),
        ("[]", "", "", "expected object, got array"),
        ("[" * 200_000, "", "", "more than 64 deep"),
        (" " * (MAX_BYTES + 1), "", "", "at most 1048576 bytes"),
        ('{"icons": [{"icon": "wait", "seconds": 1}]}', "", "name", "is missing"),
        ('{"name": "a"}', "", "icons", "is missing"),
        ('{"name": "a", "icons": []}', "", "icons", "length >= 1"),
        ('{"name": "a", "name": "b", "icons": []}', "", "name", "duplicate"),
        ('{"name": "a", "format": 2, "icons": []}', "", "format", "2"),
        ('{"name": "a", "robot": "Other", "icons": []}', "", "robot", "Other"),
        ('{"name": "a", "icons": [5]}', "icons[0]", "", "got int"),
        *((text, "", "", "") for text in ('"\\ud800"', '{"\\ud800": 1, "\\ud800": 2}', '["a\\udfff"]')),
    ],
)
def test_what_is_wrong_with_a_file_as_a_whole(text: str | bytes, icon: str, parameter: str, reason: str) -> None:
    found = refusal(text)
    assert found[:2] == (icon, parameter) or "ud" in repr(text)
    assert reason in found[2]


def one(icon: str) -> str:
    return f'{{"name": "a", "icons": [{{"icon": "wait", "seconds": 1}}, {icon}]}}'


@pytest.mark.parametrize(
    ("icon", "parameter", "reason"),
    [
        ('{"icon": "fly"}', "icon", "unknown icon 'fly'; known are mbase_path, mbase_to"),
        ('{"icon": "wait", "seconds": 1e999}', "seconds", "not a finite number"),
        ('{"icon": "wait", "seconds": %s}' % ("9" * 500_000), "seconds", "too large"),
        ('{"icon": "say", "type": "a", "payload": 99999999999999999999}', "payload", "too large"),
        ('{"icon": "say", "type": "a", "payload": {"b": "\\ud800"}}', "payload.b", "surrogate"),
        ('{"icon": "say", "type": "a", "payload": {"b": [NaN]}}', "payload.b[0]", "not a finite number"),
        ('{"icon": "say", "type": "a", "payload": %s}' % ("[" * 100 + "]" * 100), "payload" + "[0]" * 61, "64 deep"),
        ('{"icon": "wait_until", "seconds": 1, "condition": {"when": "moon"}}', "condition.when", "closer_than"),
        (
            '{"icon": "wait_until", "seconds": 1, "condition": {"when": "farther_than", "sensor": "eye"}}',
            "condition.sensor",
            "eye",
        ),
        ('{"icon": "move_table", "table": "t", "to": {"floor": "L1", "x": 1}}', "to.y", "missing"),
    ],
)
def test_what_is_wrong_inside_an_icon(icon: str, parameter: str, reason: str) -> None:
    found = refusal(one(icon))
    assert found[:2] == ("icons[1]", parameter)
    assert reason in found[2]


def test_icons_may_be_so_many_and_so_deep_and_no_more() -> None:
    def nested(depth: int) -> str:
        return '{"icon": "repeat", "times": 2, "icons": [' * depth + json.dumps(WAIT) + "]}" * depth

    assert len(list(icons_with_paths(loads(one(nested(MAX_NESTING - 1)))))) == MAX_NESTING + 1
    assert refusal(one(nested(MAX_NESTING)))[:2] == ("icons[1]" + ".icons[0]" * (MAX_NESTING - 1), "icons")
    waits = [WAIT] * (MAX_ICONS - 1)
    assert len(list(icons_with_paths(loads(json.dumps({"name": "a", "icons": [*waits, WAIT]}))))) == MAX_ICONS
    more = [*waits, {"icon": "repeat", "times": 2, "icons": waits[:1]}]
    assert refusal(json.dumps({"name": "a", "icons": more}))[:2] == ("", "icons")


def test_load_reads_a_file(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(one(json.dumps(WAIT)))
    assert load(file).name == "a"
    file.write_bytes(b" " * (MAX_BYTES + 1))
    with pytest.raises(InvalidProgram, match="1048576 bytes"):
        load(file)
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "b.json")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"{HAND_OVER}, {HAND_OVER}", "not JSON"),
        (f'{HAND_OVER}], "robot": "SmartPal", "icons": [{HAND_OVER}', "not JSON"),
        (f"[{HAND_OVER}]", "icons"),
        ("", "not JSON"),
        (json.dumps(WAIT), "wait is not a cooperative icon; known are move_table, hand_over"),
        (json.dumps({"icon": "repeat", "times": 2, "icons": [json.loads(HAND_OVER)]}), "not a cooperative icon"),
        ('{"icon": "hand_over", "object": "cup"}', "taker"),
        (" " * (MAX_BYTES + 1), "bytes"),
        ("[" * 100_000, ""),
    ],
)
def test_a_mission_is_started_from_one_cooperative_icon_alone(text: str, reason: str) -> None:
    assert of_icon(HAND_OVER).icons == (HandOver("cup", "B"),)
    with pytest.raises(InvalidProgram) as refused:
        of_icon(text)
    assert reason in str(refused.value)


SAMPLES = Path(str(files("robocorba") / "samples"))


@pytest.mark.parametrize(
    ("name", "building", "start"),
    [
        ("drive", "paper-scene", Start(Place("L1", 1.1, 3.3), 0.0)),
        ("fetch", "five-floors", Start(Place("L1", 17.0, 1.2), 1.57)),
        ("both-floors", "five-floors", Start(Place("L1", 17.0, 7.5), 1.57)),
    ],
)
def test_a_sample_is_valid_in_its_building(name: str, building: str, start: Start) -> None:
    program = load(SAMPLES / f"{name}.json")
    assert check(program, InverseKinematics(), PathPlanner(load_sample(building)), start).findings == ()
    assert dumps(program) == (SAMPLES / f"{name}.json").read_text()


@pytest.mark.parametrize(
    ("build", "parameter"),
    [
        (lambda b: b.wait(math.nan), "seconds"),
        (lambda b: b.mbase_to(1, 2, heading=math.nan), "heading"),
        (lambda b: b.mhand_joints("left", [0] * 6), "joints"),
        (lambda b: b.mhand_joints("left", [9] * 7), "joints[0]"),
        (lambda b: b.gripper("third", "open"), "hand"),
        (lambda b: b.say("a", object()), "payload"),
        (lambda b: b.say("a", {1: 2}), "payload"),
        (lambda b: b.wait_until("soon", 1), "condition"),
        (lambda b: b.move_table("t", Destination("L1", 1, math.inf)), "to.y"),
    ],
)
def test_what_python_can_get_wrong_is_refused_as_well(build: Any, parameter: str) -> None:
    with pytest.raises(InvalidProgram) as refused:
        build(ProgramBuilder("a").wait(1)).program()
    assert (refused.value.icon, refused.value.parameter) == ("icons[1]", parameter)


def test_fetch_has_what_two_robots_shall_show_and_a_builder_has_blocks() -> None:
    kinds = [kind(icon) for _, icon in icons_with_paths(load(SAMPLES / "fetch.json"))]
    assert {"mbase_path", "mhand_pose", "mhand_offset", "mhand_joints", "gripper", "stop_if_closer"} <= set(kinds)
    builder = ProgramBuilder("a").wait(1)
    with pytest.raises(ValueError, match="after the end of a branch"):
        builder.otherwise()
    with pytest.raises(KeyError), builder.repeat(2):
        builder.wait(2)
        raise KeyError
    assert builder.program().icons == (Wait(1.0),)  # as it was


def test_the_python_source_reads_like_that_of_a_person() -> None:
    fetch = ProgramBuilder("fetch").mhand_posture("both", "tuck")
    with fetch.repeat(2):
        fetch.mbase_path("L1", 1.0, 2.0, speed=0.5)
    with fetch.branch(Result("stopped")):
        fetch.say("a", {"b": [True, None]})
    with fetch.otherwise():
        fetch.move_table("desk", Destination("L1", 3.0, 2.0))
    assert python_source(fetch.program()).splitlines() == [
        "from robocorba.robot.programs.graphic_programming import ProgramBuilder",
        "from robocorba.robot.programs.icons import Destination, Result",
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
    ]


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
    lines = python_source(ProgramBuilder(name).wait(1.0).program()).splitlines()
    assert lines[-1] == f'program.write("{file}")'
    assert all(line.isprintable() for line in lines)
    assert Path(file).name == file
