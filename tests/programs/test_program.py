"""Programs: read, written, made in Python; every malformed one refused with icon and parameter."""

from __future__ import annotations

import inspect
import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings

from robocorba.errors.robots import InvalidProgram
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.icons import (
    ICONS,
    Branch,
    Destination,
    FartherThan,
    Gripper,
    MbasePath,
    Repeat,
    Result,
    Say,
    StopIfCloser,
    Wait,
    WaitUntil,
)
from robocorba.programs.program import MAX_BYTES, MAX_ICONS, MAX_NESTING, Program, dumps, icons_with_paths, load, loads
from tests.programs import json_schema
from tests.programs.plain_programs import PROGRAMS, SCHEMA, Malformed, malformed

UNHURRIED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])


@settings(UNHURRIED, max_examples=60)
@given(PROGRAMS)
def test_what_the_schema_accepts_is_read_and_written_the_same(plain: dict[str, Any]) -> None:
    program = loads(json.dumps(plain))
    written = dumps(program)
    assert loads(written) == program
    assert json_schema.problems(SCHEMA, json.loads(written)) == []
    assert len(list(icons_with_paths(program))) == written.count('"icon":')  # payloads are too short to hold it


@settings(UNHURRIED, max_examples=500)
@given(malformed())
def test_five_hundred_malformed_programs_are_refused_with_icon_and_parameter(wrong: Malformed) -> None:
    with pytest.raises(InvalidProgram) as refused:
        loads(wrong.text)
    error = refused.value
    assert error.icon == wrong.icon
    assert error.parameter == wrong.parameter or error.parameter.startswith(
        f"{wrong.parameter}["
    )  # one of seven joints
    assert error.reason
    if wrong.is_against_schema:
        assert json_schema.problems(SCHEMA, json.loads(wrong.text))


def refusal(text: str | bytes) -> tuple[str, str, str]:
    with pytest.raises(InvalidProgram) as refused:
        loads(text)
    return refused.value.icon, refused.value.parameter, refused.value.reason


@pytest.mark.parametrize(
    ("text", "icon", "parameter", "reason"),
    [
        (b"\xff\xfe", "", "", "not UTF-8"),
        ("{", "", "", "not JSON"),
        ("", "", "", "not JSON"),
        ("[]", "", "", "expected object, got array"),
        ("[" * 200_000, "", "", "more than 64 deep"),
        (" " * (MAX_BYTES + 1), "", "", "at most 1048576 bytes"),
        ('{"icons": [{"icon": "wait", "seconds": 1}]}', "", "name", "is missing"),
        ('{"name": "a"}', "", "icons", "is missing"),
        ('{"name": "a", "icons": []}', "", "icons", "length >= 1"),
        ('{"name": "a", "icons": 3}', "", "icons", "got int"),
        ('{"name": "a", "name": "b", "icons": []}', "", "name", "duplicate"),
        ('{"name": "a", "format": 2, "icons": []}', "", "format", "2"),
        ('{"name": "a", "robot": "Other", "icons": []}', "", "robot", "Other"),
        ('{"name": "a", "icons": [5]}', "icons[0]", "", "got int"),
    ],
)
def test_what_is_wrong_with_a_file_as_a_whole(text: str | bytes, icon: str, parameter: str, reason: str) -> None:
    found = refusal(text)
    assert found[:2] == (icon, parameter)
    assert reason in found[2]


def one(icon: str) -> str:
    return f'{{"name": "a", "icons": [{{"icon": "wait", "seconds": 1}}, {icon}]}}'


@pytest.mark.parametrize(
    ("icon", "parameter", "reason"),
    [
        ('{"icon": "fly"}', "icon", "unknown icon 'fly'; known are mbase_path, mbase_to"),
        ('{"icon": "wait", "seconds": 1e999}', "seconds", "not a finite number"),
        ('{"icon": "wait", "seconds": %s}' % ("9" * 500_000), "seconds", "too large"),
        ('{"icon": "wait", "seconds": "1"}', "seconds", "expected float, got str"),
        ('{"icon": "say", "type": "a", "payload": 99999999999999999999}', "payload", "too large"),
        ('{"icon": "say", "type": "a", "payload": {"b": "\\ud800"}}', "payload.b", "surrogate"),
        ('{"icon": "say", "type": "a", "payload": {"b": [NaN]}}', "payload.b[0]", "not a finite number"),
        ('{"icon": "wait_until", "seconds": 1, "condition": {"when": "moon"}}', "condition.when", "closer_than"),
        ('{"icon": "wait_until", "seconds": 1, "condition": {"hand": "left"}}', "condition.when", "missing"),
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


def test_a_payload_that_is_very_deep_is_refused_with_its_icon() -> None:
    icon, parameter, reason = refusal(one('{"icon": "say", "type": "a", "payload": %s}' % ("[" * 100 + "]" * 100)))
    assert (icon, parameter.partition("[")[0]) == ("icons[1]", "payload")
    assert "64 deep" in reason


def nested(depth: int) -> str:
    return '{"icon": "repeat", "times": 2, "icons": [' * depth + '{"icon": "wait", "seconds": 1}' + "]}" * depth


def test_icons_may_be_nested_so_deep_and_no_deeper() -> None:
    assert len(list(icons_with_paths(loads(one(nested(MAX_NESTING - 1)))))) == MAX_NESTING + 1
    assert refusal(one(nested(MAX_NESTING)))[:2] == ("icons[1]" + ".icons[0]" * (MAX_NESTING - 1), "icons")


def test_a_program_may_have_so_many_icons_and_no_more() -> None:
    waits = [{"icon": "wait", "seconds": 1}] * (MAX_ICONS - 1)
    assert len(list(icons_with_paths(loads(json.dumps({"name": "a", "icons": [*waits, waits[0]]}))))) == MAX_ICONS
    more = [*waits, {"icon": "repeat", "times": 2, "icons": waits[:1]}]
    assert refusal(json.dumps({"name": "a", "icons": more}))[:2] == ("", "icons")


def test_walk_names_every_icon() -> None:
    wait = Wait(1.0)
    branch = Branch(Result("done"), (wait,), (Repeat(2, (wait,)),))
    assert [path for path, _ in icons_with_paths(Program(name="a", icons=(wait, branch)))] == [
        "icons[0]",
        "icons[1]",
        "icons[1].then[0]",
        "icons[1].otherwise[0]",
        "icons[1].otherwise[0].icons[0]",
    ]


def test_load_reads_a_file(tmp_path: Any) -> None:
    file = tmp_path / "a.json"
    file.write_text(one(nested(1)))
    assert load(file).name == "a"
    file.write_bytes(b" " * (MAX_BYTES + 1))
    with pytest.raises(InvalidProgram, match="1048576 bytes"):
        load(file)
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "b.json")


# ---- in Python ----


def test_the_builder_puts_together_what_the_classes_say() -> None:
    fetch = ProgramBuilder("fetch")
    with fetch.stop_if_closer("laser", 0.4):
        fetch.mbase_path("L3", 10, 4)
        with fetch.repeat(2):
            fetch.wait(1).wait(2)
    with fetch.branch(Result("stopped")):
        fetch.say("blocked", {"by": ["a", 1, None]})
    with fetch.otherwise():
        fetch.gripper("left", "close", force=5)
    fetch.wait_until(FartherThan("front", 0.5), 10)
    assert fetch.program() == Program(
        name="fetch",
        icons=(
            StopIfCloser("laser", 0.4, (MbasePath("L3", 10.0, 4.0), Repeat(2, (Wait(1.0), Wait(2.0))))),
            Branch(
                Result("stopped"),
                (Say("blocked", {"by": ["a", 1, None]}),),
                (Gripper("left", "close", force=5.0),),
            ),
            WaitUntil(FartherThan("front", 0.5), 10.0),
        ),
    )


@pytest.mark.parametrize("tag", ICONS)
def test_the_builder_has_a_method_for_each_icon_with_its_parameters(tag: str) -> None:
    bodies = {"icons", "then", "otherwise"}
    wanted = [field for field in msgspec.structs.fields(ICONS[tag]) if field.name not in bodies]
    found = list(inspect.signature(getattr(ProgramBuilder("a"), tag)).parameters.values())
    assert [parameter.name for parameter in found] == [field.name for field in wanted]
    for parameter, field in zip(found, wanted, strict=True):
        default = inspect.Parameter.empty if field.required else field.default
        assert parameter.default == default


@pytest.mark.parametrize(
    ("build", "icon", "parameter"),
    [
        (lambda b: b.wait(math.nan), "icons[1]", "seconds"),
        (lambda b: b.mbase_to(1, 2, heading=math.nan), "icons[1]", "heading"),
        (lambda b: b.mhand_joints("left", [0] * 6), "icons[1]", "joints"),
        (lambda b: b.mhand_joints("left", [9] * 7), "icons[1]", "joints[0]"),
        (lambda b: b.gripper("third", "open"), "icons[1]", "hand"),
        (lambda b: b.say("a", object()), "icons[1]", "payload"),
        (lambda b: b.say("a", {1: 2}), "icons[1]", "payload"),
        (lambda b: b.wait_until("soon", 1), "icons[1]", "condition"),
        (lambda b: b.move_table("t", Destination("L1", 1, math.inf)), "icons[1]", "to.y"),
    ],
)
def test_what_python_can_get_wrong_is_refused_as_well(build: Any, icon: str, parameter: str) -> None:
    with pytest.raises(InvalidProgram) as refused:
        build(ProgramBuilder("a").wait(1)).program()
    assert (refused.value.icon, refused.value.parameter) == (icon, parameter)


def test_otherwise_needs_a_branch_before_it() -> None:
    builder = ProgramBuilder("a").wait(1)
    with pytest.raises(ValueError, match="after the end of a branch"):
        builder.otherwise()


def test_an_error_inside_a_block_leaves_the_builder_as_it_was() -> None:
    builder = ProgramBuilder("a").wait(1)
    with pytest.raises(KeyError), builder.repeat(2):
        builder.wait(2)
        raise KeyError
    assert builder.program().icons == (Wait(1.0),)


@pytest.mark.parametrize("text", ['"\\ud800"', '{"\\ud800": 1, "\\ud800": 2}', '{"\\uD800": 1}', '["a\\udfff"]'])
def test_half_a_character_is_refused_with_a_message_that_can_be_sent(text: str) -> None:
    with pytest.raises(InvalidProgram) as refused:
        loads(text)
    assert str(refused.value).encode()
