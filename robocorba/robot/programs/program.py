"""A program and its JSON format: reading, validation, writing. Errors name icon and parameter."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import msgspec

from robocorba.errors.robots import InvalidProgram
from robocorba.robot.programs.icons import CONDITIONS, ICONS, Body, CooperativeIcon, Icon, Text, bodies, kind
from robocorba.system.decoding import convert

#: Size limit of a program file [bytes].
MAX_BYTES = 1024 * 1024
#: Maximum number of icons of a program, including nested ones.
MAX_ICONS = 1000
#: Maximum nesting depth of icons; those of the program itself have depth 1.
MAX_NESTING = 8
#: Maximum nesting depth of objects and arrays, including an event's payload.
MAX_DEPTH = 64


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program of a robot: icons that it runs in sequence. format: version of the file format."""

    format: Literal[1] = 1
    name: Text
    robot: Literal["SmartPal"] = "SmartPal"
    icons: Body


def load(file: str | Path) -> Program:
    """Read a program file. Raises InvalidProgram, and OSError if the file cannot be read."""
    with Path(file).open("rb") as source:
        return loads(source.read(MAX_BYTES + 1))


def loads(text: str | bytes) -> Program:
    """A program from JSON. Raises InvalidProgram, which names the first invalid icon and parameter."""
    return _converted(_parsed(text))


def of_icon(text: str) -> Program:
    """A program of one cooperative icon, from the icon's JSON. Raises InvalidProgram."""
    program = _converted({"name": "mission", "icons": [_parsed(text)]})
    (icon,) = program.icons
    if not isinstance(icon, CooperativeIcon):
        known = ", ".join(tag for tag, each in ICONS.items() if issubclass(each, CooperativeIcon))
        raise InvalidProgram("icons[0]", "icon", f"{kind(icon)} is not a cooperative icon; known are {known}")
    return program


def _parsed(text: str | bytes) -> Any:
    """Decoded JSON. Raises InvalidProgram."""
    try:
        data = text.encode() if isinstance(text, str) else text
        if len(data) > MAX_BYTES:
            raise InvalidProgram("", "", f"a program has at most {MAX_BYTES} bytes")
        return json.loads(data.decode(), object_pairs_hook=_object, parse_int=_integer)
    except RecursionError:
        raise _too_deep("") from None
    except UnicodeError:
        raise InvalidProgram("", "", "not UTF-8") from None
    except ValueError as error:
        raise InvalidProgram("", "", f"not JSON: {error}") from None


def checked(program: Program) -> Program:
    """The program, validated like one from a file; for programs built in Python. Raises InvalidProgram."""
    try:
        return _converted(msgspec.to_builtins(program))
    except RecursionError:
        raise _too_deep("") from None
    except (TypeError, ValueError) as error:
        raise InvalidProgram(*_unwritable(program), str(error)) from None


def dumps(program: Program) -> str:
    """A program as indented JSON; loading it gives an equal program."""
    return msgspec.json.format(msgspec.json.encode(program), indent=2).decode() + "\n"


def schema() -> dict[str, Any]:
    """The JSON schema of program files."""
    found = msgspec.json.decode(msgspec.json.encode(msgspec.json.schema(Program)))
    for definition in found["$defs"].values():
        definition["description"] = " ".join(definition["description"].split())
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A RoboCorba program",
        "$ref": found["$ref"],
        "$defs": found["$defs"],
    }


def icons_with_paths(program: Program) -> Iterator[tuple[str, Icon]]:
    """Every icon, including nested ones, with its path, such as icons[2].then[0]; in the order of the file."""
    for path, icon, _ in _nested("icons", program.icons, 1):
        yield path, icon


def _nested(parent: str, icons: tuple[Icon, ...], depth: int) -> Iterator[tuple[str, Icon, int]]:
    for number, icon in enumerate(icons):
        path = f"{parent}[{number}]"
        yield path, icon, depth
        for name, body in bodies(icon):
            yield from _nested(f"{path}.{name}", body, depth + 1)


# ---- from decoded JSON ----


class _DuplicateKey(dict[str, Any]):
    """A JSON object with the duplicate key `key`."""

    key = ""


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) == len(pairs):
        return found
    keys = [key for key, _ in pairs]
    broken = _DuplicateKey(found)
    broken.key = next(key for key in keys if keys.count(key) > 1)
    return broken


def _integer(text: str) -> int | float:
    """Integers of more than 20 digits count as infinite, because Python parses them slowly."""
    return int(text) if len(text) <= 20 else math.inf


def _converted(plain: Any) -> Program:
    _check_plain(plain, "$", 1)
    try:
        program = convert(plain, Program)
    except msgspec.ValidationError as error:
        raise _translated(str(error)) from None
    count = 0
    for path, icon, depth in _nested("icons", program.icons, 1):
        count += 1
        if depth == MAX_NESTING and any(body for _, body in bodies(icon)):
            name = next(name for name, body in bodies(icon) if body)
            raise InvalidProgram(path, name, f"icons are nested more than {MAX_NESTING} deep")
    if count > MAX_ICONS:
        raise InvalidProgram("", "icons", f"{count} icons in all; at most {MAX_ICONS} are allowed")
    return program


def _check_plain(value: Any, at: str, depth: int) -> None:
    """Raise InvalidProgram for what Python's JSON reader accepts and JSON does not allow: duplicate keys, numbers that
    are not finite, text that is not UTF-8."""
    if isinstance(value, dict | list | tuple) and depth > MAX_DEPTH:
        raise _too_deep(at)
    if isinstance(value, dict):
        if isinstance(value, _DuplicateKey):
            _check_text(value.key, at)
            raise _located(f"{at}.{value.key}", "is a duplicate key")
        for key, part in value.items():
            if not isinstance(key, str):
                raise _located(at, f"{key!r:.80} cannot be a key in JSON")
            _check_text(key, at)
            _check_plain(part, f"{at}.{key}", depth + 1)
    elif isinstance(value, list | tuple):
        for number, part in enumerate(value):
            _check_plain(part, f"{at}[{number}]", depth + 1)
    elif isinstance(value, float) and not math.isfinite(value):
        raise _located(at, "is not a finite number, or too large")
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise _located(at, "is too large")
    elif isinstance(value, str):
        _check_text(value, at)


def _check_text(text: str, at: str) -> None:
    try:
        text.encode()
    except UnicodeError:
        raise _located(at, "contains half of a surrogate pair, which is no character") from None


# ---- errors ----


def _unwritable(program: Program) -> tuple[str, str]:
    """Icon and parameter with a value that JSON cannot represent."""
    for path, icon in icons_with_paths(program):
        inside = {name for name, _ in bodies(icon)}
        for name in set(icon.__struct_fields__) - inside:
            try:
                msgspec.to_builtins(getattr(icon, name))
            except (TypeError, ValueError):
                return path, name
    return "", ""


_ICON = re.compile(r"\$((?:\.(?:icons|then|otherwise)\[\d+\])*)\.?(.*)", re.DOTALL)
_TAGS = {"icon": ("icon", ", ".join(ICONS)), "when": ("condition", ", ".join(CONDITIONS))}


def _located(at: str, reason: str) -> InvalidProgram:
    """The error at a path such as $.icons[2].joints[0]."""
    found = _ICON.fullmatch(at)
    icon, parameter = found.groups() if found else ("", at)
    return InvalidProgram(icon.removeprefix("."), _short(parameter), _short(reason))


def _translated(message: str) -> InvalidProgram:
    """msgspec's message in terms of the program."""
    found = re.fullmatch(r"(.*?)(?: - at `(\$.*)`)?", message, re.DOTALL)
    reason, at = (found[1], found[2] or "$") if found else (message, "$")
    if missing := re.fullmatch(r"Object missing required field `(.*)`", reason):
        return _located(f"{at}.{missing[1]}", "is missing")
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", reason, re.DOTALL):
        return _located(f"{at}.{unknown[1]}", "unknown parameter")
    tag = at.rpartition(".")[2]
    if tag in _TAGS and reason.startswith("Invalid value"):
        what, known = _TAGS[tag]
        given = _short(reason.removeprefix("Invalid value "))
        return _located(at, f"unknown {what} {given}; known are {known}")
    return _located(at, reason[:1].lower() + reason[1:].replace("`", ""))


def _too_deep(at: str) -> InvalidProgram:
    reason = f"objects and arrays are inside each other more than {MAX_DEPTH} deep"
    return _located(at, reason) if at else InvalidProgram("", "", reason)


def _short(text: str) -> str:
    return text if len(text) <= 400 else f"{text[:380]}…"
