"""Untrusted YAML: bounded in bytes, values and depth, without aliases, and with the line of every key.

Maps need no aliases, and "YAML bombs" consist of them, so aliases are rejected. The parser's
events are converted directly to plain data, without a tree of nodes. The line of a key is
looked up in the text only for an error.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import yaml

from robocorba.errors.maps import MapFileError
from robocorba.system.decoding import convert

#: A longer scalar is text [characters]: Python needs minutes to parse a number of a million digits.
MAX_NUMBER_LENGTH = 100
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
T = TypeVar("T")


@dataclass(frozen=True)
class YamlLimits:
    """Limits of a file: its size, its scalars, mappings and sequences (keys included), and their nesting depth."""

    size_bytes: int = 64 * 1024 * 1024
    values: int = 5_000_000
    depth: int = 40


DEFAULT_LIMITS = YamlLimits()


@dataclass(frozen=True)
class YamlFile:
    """Plain data, and the source text to look up lines."""

    name: str
    data: Any
    text: str = field(repr=False)

    def line(self, key: str) -> int:
        """1-based line of a key path such as `$.floors[0].name`, or of its nearest existing parent."""
        return _line_at(self.text, _child_indices(self.data, key.removeprefix("$")))

    def error(self, key: str, reason: str) -> MapFileError:
        """The error to raise for the value at a key path."""
        shown = key.removeprefix("$").removeprefix(".")
        return MapFileError(self.name, self.line(key), _short(shown), _short(reason))

    def convert(self, schema: type[T]) -> T:
        """The data as `schema` (a msgspec type). Raises MapFileError with line and key."""
        try:
            return convert(self.data, schema)
        except msgspec.ValidationError as error:
            found = re.fullmatch(r"(.*) - at (`key` in )?`(\$.*)`", str(error), re.DOTALL)
            reason, of_key, key = found.groups() if found else (str(error), None, "$")
            unknown = re.fullmatch(r"Object contains unknown field `(.*)`", reason, re.DOTALL)
            if unknown:
                raise self.error(f"{key}.{unknown[1]}", "there is no such key") from None
            is_text = reason in ("Expected `float`, got `str`", "Expected `int`, got `str`")
            if is_text and (hint := number_hint(self.value(key))):
                reason = hint
            raise self.error(key, f"a key is wrong: {reason}" if of_key else reason) from None

    def value(self, key: str) -> Any:
        """The value at a key path, or its nearest existing parent."""
        found = self.data
        for child in _child_indices(self.data, key.removeprefix("$")):
            found = found[child] if isinstance(found, list) else list(found.values())[child]
        return found


def read_yaml(path: str | Path, limits: YamlLimits = DEFAULT_LIMITS) -> YamlFile:
    """Read a YAML file. Raises MapFileError with the line if it is not acceptable YAML."""
    try:
        with open(path, "rb") as file:
            raw = file.read(limits.size_bytes + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise MapFileError(_short(str(path)), 0, "", reason or str(error)) from None
    return parse_yaml(raw, str(path), limits)


def parse_yaml(raw: bytes, name: str, limits: YamlLimits = DEFAULT_LIMITS) -> YamlFile:
    """Parse YAML from bytes. Errors use `name` as the file name. Raises MapFileError."""
    if len(raw) > limits.size_bytes:
        raise MapFileError(name, 0, "", f"larger than {limits.size_bytes // 1024} KiB")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapFileError(name, raw[: error.start].count(b"\n") + 1, "", "not UTF-8 text") from None
    try:
        return YamlFile(name, _Reader(text, name, limits).document(), text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        # libyaml 0.2.6 and later (PyYAML 6.0.4) read ahead: they refuse 1,000 levels before our limit is checked.
        if error.problem == "exceeded maximum nesting depth":
            raise MapFileError(name, mark.line + 1 if mark else 0, "", _too_deep(limits)) from None
        if "quoted scalar" in str(error.context):
            mark = error.context_mark  # of the opening quote; the parser detects a missing one at the end of the file
        raise MapFileError(name, mark.line + 1 if mark else 0, "", error.problem or "not YAML") from None
    except yaml.reader.ReaderError as error:
        line = text.encode()[: error.position].count(b"\n") + 1
        raise MapFileError(name, line, "", f"not YAML: {error.reason}") from None
    except yaml.YAMLError as error:
        raise MapFileError(name, 0, "", f"not YAML: {str(error).splitlines()[0]}") from None


class _Reader:
    """Converts the parser events of one document to plain data."""

    def __init__(self, text: str, name: str, limits: YamlLimits) -> None:
        self._events, self._name, self._limits = _events(text), name, limits
        self._left = limits.values
        self._path: list[Any] = []
        self._resolver = yaml.resolver.Resolver()

    def document(self) -> Any:
        first = next(self._events)
        if isinstance(first, yaml.StreamEndEvent):
            raise MapFileError(self._name, 1, "", "empty file")
        data = self._value(first)
        more = next(self._events)
        if not isinstance(more, yaml.StreamEndEvent):
            raise self._error(more, "only one document is accepted")
        return data

    def _value(self, event: yaml.Event) -> Any:
        self._left -= 1
        if self._left < 0:
            raise self._error(event, f"more than {self._limits.values} values")
        if isinstance(event, yaml.ScalarEvent):
            return self._scalar(event)
        if isinstance(event, yaml.AliasEvent):
            raise self._error(event, "aliases are not accepted")
        if len(self._path) >= self._limits.depth:
            raise self._error(event, _too_deep(self._limits))
        return self._sequence() if isinstance(event, yaml.SequenceStartEvent) else self._mapping()

    def _sequence(self) -> list[Any]:
        found: list[Any] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            self._path.append(len(found))
            found.append(self._value(event))
            self._path.pop()
        return found

    def _mapping(self) -> dict[Any, Any]:
        found: dict[Any, Any] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                raise self._error(event, "a key must be a plain word")
            label = self._value(event)
            self._path.append(str(label))
            if label in found:
                raise self._error(event, "given twice")
            found[label] = self._value(next(self._events))
            self._path.pop()
        return found

    def _scalar(self, event: yaml.ScalarEvent) -> Any:
        value, tag = event.value, event.tag
        if tag is None or tag == "!":
            if tag or not event.implicit[0] or len(value) > MAX_NUMBER_LENGTH:
                return value
            tag = self._resolver.resolve(yaml.ScalarNode, value, event.implicit)
        if tag == "tag:yaml.org,2002:str":
            return value
        if tag == "tag:yaml.org,2002:null":
            return None
        try:
            if tag in _CONSTRUCTORS and len(value) <= MAX_NUMBER_LENGTH:
                return _CONSTRUCTORS[tag](yaml.ScalarNode(tag, value))
        except (ValueError, KeyError, OverflowError):
            raise self._error(event, f"{_short(value)!r} is not a value") from None
        if event.tag is None:
            return value  # e.g. a date, which maps do not use
        raise self._error(event, f"{_short(value)!r} is not a value")

    def _error(self, event: yaml.Event, reason: str) -> MapFileError:
        key = "".join(f"[{step}]" if isinstance(step, int) else f".{_short(step)}" for step in self._path)
        return MapFileError(self._name, _line(event), _short(key.removeprefix(".")), reason)


_scalars = yaml.constructor.SafeConstructor()
_CONSTRUCTORS: dict[str, Callable[[yaml.ScalarNode], Any]] = {
    "tag:yaml.org,2002:int": _scalars.construct_yaml_int,
    "tag:yaml.org,2002:float": _scalars.construct_yaml_float,
    "tag:yaml.org,2002:bool": _scalars.construct_yaml_bool,
}


def number_hint(value: Any) -> str:
    """What to write instead of a text that other programs print for a number, such as -nan; empty for anything else."""
    if isinstance(value, str) and value.strip().lstrip("+-").lower() in ("nan", "inf", "infinity", "nan(ind)"):
        return f"{_short(value)!r} is a text in YAML and no number; write a finite number, such as 0.5"
    return ""


def _too_deep(limits: YamlLimits) -> str:
    return f"nested deeper than {limits.depth}"


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 0


def _events(text: str) -> Iterator[yaml.Event]:
    """The parser events of a text, without those that open and close the stream and its documents."""
    skipped = (yaml.StreamStartEvent, yaml.DocumentStartEvent, yaml.DocumentEndEvent)
    for event in yaml.parse(text, Loader=_Loader):
        if not isinstance(event, skipped):
            yield event


def _child_indices(data: Any, path: str) -> list[int]:
    """Child indices along a key path, as far as it exists. If several labels match, the longest wins."""
    children: list[int] = []
    while path:
        if isinstance(data, list):
            index = re.match(r"\[(\d{1,9})\]", path)
            if not index or int(index[1]) >= len(data):
                break
            child, length, data = int(index[1]), index.end(), data[int(index[1])]
        elif isinstance(data, dict):
            fitting = [
                (len(start), child, label)
                for child, label in enumerate(data)
                if path.startswith(start := f".{label}") and path[len(start) : len(start) + 1] in ("", ".", "[")
            ]
            if not fitting:
                break
            length, child, label = max(fitting, key=lambda found: found[0])
            data = data[label]
        else:
            break
        children.append(child)
        path = path[length:]
    return children


def _line_at(text: str, children: list[int]) -> int:
    """The line of the value at the given child index of each level."""
    events = _events(text)
    event = next(events)
    for child in children:
        mapping = isinstance(event, yaml.MappingStartEvent)
        for _ in range(2 * child + 1 if mapping else child):
            _skip(next(events), events)
        event = next(events)
    return _line(event)


def _skip(event: yaml.Event, events: Iterator[yaml.Event]) -> None:
    depth = 0
    while True:
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if not depth:
            return
        event = next(events)


def _short(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:120]}… ({len(text)} characters)"
