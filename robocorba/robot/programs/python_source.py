"""A program as Python: the source that builds it with a ProgramBuilder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import msgspec

from robocorba.robot.programs.icons import Branch, Condition, Destination, Icon, bodies, kind
from robocorba.robot.programs.program import Program, icons_with_paths


def python_source(program: Program) -> str:
    """The source of a module that builds an equal program and writes its file."""
    used = sorted({type(value).__name__ for _, icon in icons_with_paths(program) for value in _nested_values(icon)})
    lines = ["from robocorba.robot.programs.graphic_programming import ProgramBuilder"]
    if used:
        lines.append(f"from robocorba.robot.programs.icons import {', '.join(used)}")
    lines += ["", f"program = ProgramBuilder({_literal(program.name)})", *_calls(program.icons, "")]
    lines.append(f"program.write({_literal(_file_name(program.name))})")
    return "\n".join(lines) + "\n"


def _nested_values(icon: Icon) -> Iterator[Condition | Destination]:
    for field in msgspec.structs.fields(icon):
        value = getattr(icon, field.name)
        if isinstance(value, Condition | Destination):
            yield value


def _calls(icons: tuple[Icon, ...], indent: str) -> Iterator[str]:
    for icon in icons:
        call = f"program.{kind(icon)}({_arguments(icon)})"
        inner = dict(bodies(icon))
        if not inner:
            yield indent + call
            continue
        yield f"{indent}with {call}:"
        yield from _calls(next(iter(inner.values())), indent + "    ")
        if isinstance(icon, Branch) and icon.otherwise:
            yield f"{indent}with program.otherwise():"
            yield from _calls(icon.otherwise, indent + "    ")


def _arguments(value: Icon | Condition | Destination) -> str:
    """Required parameters by position, others by keyword where they differ from their defaults."""
    inner = {name for name, _ in bodies(value)} if isinstance(value, Icon) else set()
    found = []
    for field in msgspec.structs.fields(value):
        given = getattr(value, field.name)
        if field.name in inner:
            continue
        if field.required:
            found.append(_literal(given))
        elif given != field.default:
            found.append(f"{field.name}={_literal(given)}")
    return ", ".join(found)


def _literal(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False) if value.isprintable() else ascii(value)
    if isinstance(value, msgspec.Struct):
        return f"{type(value).__name__}({_arguments(value)})"  # type: ignore[arg-type]
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_literal, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_literal(key)}: {_literal(entry)}" for key, entry in value.items()) + "}"
    return repr(value)


def _file_name(name: str) -> str:
    """A file name for a program: other characters than letters, digits, dots and dashes become underscores."""
    kept = "".join(letter if letter.isalnum() or letter in ".-" else "_" for letter in name)
    shortened = kept.encode()[:80].decode(errors="ignore")
    return f"{shortened.strip('.') or 'program'}.json"
