"""YAML from strangers: bounded, without aliases, and with the line of every key.

Aliases are what a "YAML bomb" is made of, and no map needs them, so they are refused
before anything is built; deep nesting likewise, because the composer recurses.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import yaml

from robocorba.errors import MapFileError

MAX_BYTES = 64 * 1024 * 1024
MAX_DEPTH = 40

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
T = TypeVar("T")


@dataclass(frozen=True)
class YamlFile:
    """Plain data, and the 1-based line of each key path such as `$.floors[0].name`."""

    name: str
    data: Any
    lines: dict[str, int]

    def line(self, key: str) -> int:
        """Line of a key path or of its nearest enclosing one; 0 where there is none."""
        while key:
            if key in self.lines:
                return self.lines[key]
            key = re.sub(r"(\.[^.\[\]]*|\[[^\]]*\])$", "", key) if key != "$" else ""
        return 0

    def error(self, key: str, reason: str) -> MapFileError:
        """The error to raise for what stands at a key path."""
        return MapFileError(self.name, self.line(key), key.removeprefix("$").removeprefix("."), reason)

    def convert(self, schema: type[T]) -> T:
        """The data as `schema` (a msgspec type). Raises MapFileError with line and key."""
        try:
            return msgspec.convert(self.data, schema)
        except msgspec.ValidationError as wrong:
            reason, _, key = str(wrong).partition(" - at `")
            raise self.error(key.rstrip("`") or "$", reason) from None


def read_bytes(path: str | Path, limit: int = MAX_BYTES) -> bytes:
    """A file's bytes. Raises MapFileError where it can't be read or is larger than `limit`."""
    try:
        with open(path, "rb") as file:
            data = file.read(limit + 1)
    except OSError as wrong:
        raise MapFileError(str(path), 0, "", wrong.strerror or str(wrong)) from None
    if len(data) > limit:
        raise MapFileError(str(path), 0, "", f"larger than {limit // 1024} KiB")
    return data


def read_yaml(path: str | Path) -> YamlFile:
    """Read a YAML file. Raises MapFileError with the line where it is not acceptable YAML."""
    return parse_yaml(read_bytes(path), str(path))


def parse_yaml(raw: bytes, name: str) -> YamlFile:
    """Parse YAML from bytes; `name` is what errors call the file."""
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as wrong:
        raise MapFileError(name, raw[: wrong.start].count(b"\n") + 1, "", "not UTF-8 text") from None
    try:
        _refuse_bombs(text, name)
        node = yaml.compose(text, Loader=_Loader)
        if node is None:
            raise MapFileError(name, 1, "", "empty file")
        lines: dict[str, int] = {}
        data = _build(node, "$", lines, name)
    except yaml.MarkedYAMLError as wrong:
        mark = wrong.problem_mark or wrong.context_mark
        raise MapFileError(name, mark.line + 1 if mark else 0, "", wrong.problem or "not YAML") from None
    except yaml.YAMLError as wrong:
        raise MapFileError(name, 0, "", f"not YAML: {str(wrong).splitlines()[0]}") from None
    return YamlFile(name, data, lines)


def _refuse_bombs(text: str, name: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise MapFileError(name, event.start_mark.line + 1, "", "aliases are not accepted")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise MapFileError(name, event.start_mark.line + 1, "", f"nested deeper than {MAX_DEPTH}")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


_scalars = yaml.constructor.SafeConstructor()


def _build(node: yaml.Node, key: str, lines: dict[str, int], name: str) -> Any:
    lines[key] = node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        return [_build(item, f"{key}[{index}]", lines, name) for index, item in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode):
        found: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                raise MapFileError(name, line, key.removeprefix("$."), "a key must be a plain word")
            label = _scalar(key_node, key, name)
            if label in found:
                raise MapFileError(name, line, f"{key}.{label}".removeprefix("$."), "given twice")
            found[label] = _build(value_node, f"{key}.{label}", lines, name)
        return found
    return _scalar(node, key, name)


def _scalar(node: yaml.Node, key: str, name: str) -> Any:
    try:
        return _scalars.construct_object(node)
    except (ValueError, TypeError, OverflowError, yaml.constructor.ConstructorError):
        line = node.start_mark.line + 1
        raise MapFileError(name, line, key.removeprefix("$."), f"{str(node.value)[:40]!r} is not a value") from None
    finally:
        _scalars.constructed_objects.clear()
