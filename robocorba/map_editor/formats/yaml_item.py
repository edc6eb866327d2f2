"""A value of a YAML file with its position. Values are checked on access; every error names file, line and key."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from robocorba.errors.maps import MapFileError
from robocorba.map_editor.element_rules import MAX_NAME
from robocorba.map_editor.yaml_file import YamlFile, number_hint

#: Maximum absolute value of numbers. Larger ones are no position in a building in any unit.
MAX_NUMBER = 1e9
#: Assumed distance between levels whose elevations are equal or missing [m].
STOREY_M = 3.0
#: Number as text: yaml-cpp writes 1e-05, which is text in YAML 1.1.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Item:
    """A value of the file and its key path."""

    file: YamlFile
    key: str
    value: Any

    def error(self, reason: str) -> MapFileError:
        """The MapFileError to raise for this value."""
        return self.file.error(self.key, reason)

    def get(self, *names: str) -> Item:
        """The first given member of a mapping, with the value None if all are missing or empty."""
        given = (name for name in names if self.mapping().get(name) is not None)
        name = next(given, names[-1])
        return Item(self.file, f"{self.key}.{name}", self.mapping().get(name))

    def need(self, name: str) -> Item:
        """A required member. Raises MapFileError if it is missing."""
        item = self.get(name)
        if item.value is None:
            raise self.error(f"the key {name!r} is missing")
        return item

    def mapping(self) -> dict[Any, Any]:
        """The value as a mapping. An empty value is an empty mapping."""
        if self.value is None:
            return {}
        if not isinstance(self.value, dict):
            raise self.error("expected a mapping")
        return self.value

    def members(self) -> Iterator[tuple[str, Item]]:
        """Names and values of a mapping."""
        for label, value in self.mapping().items():
            item = Item(self.file, f"{self.key}.{label}", value)
            yield Item(self.file, item.key, label).text(), item

    def items(self) -> list[Item]:
        """The values of a list. An empty value or mapping is an empty list."""
        if self.value is None or self.value == {}:
            return []
        if not isinstance(self.value, list):
            raise self.error("expected a list")
        return [Item(self.file, f"{self.key}[{i}]", value) for i, value in enumerate(self.value)]

    def number(self, default: float | None = None) -> float:
        """The value as a finite number, or `default` if it is missing."""
        value = default if self.value is None else self.value
        if isinstance(value, str) and len(value) < 40 and _NUMBER.fullmatch(value):
            value = float(value)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(number_hint(value) or "expected a number")
        if not -MAX_NUMBER <= value <= MAX_NUMBER:
            raise self.error(
                "the number is too large" if MAX_NUMBER < abs(value) < math.inf else "expected a finite number"
            )
        return float(value)

    def integer(self) -> int:
        """The value as a whole number."""
        number = self.number()
        if not number.is_integer():
            raise self.error("expected a whole number")
        return int(number)

    def positive(self) -> float:
        """The value as a number above zero."""
        number = self.number()
        if number <= 0:
            raise self.error("expected a number above zero")
        return number

    def text(self) -> str:
        """The value as a name, in NFC and without blanks at its ends. Numbers and YAML keywords are names too."""
        if isinstance(self.value, (dict, list)) or (isinstance(self.value, int) and abs(self.value) > MAX_NUMBER):
            raise self.error("expected a text")
        text = "" if self.value is None else unicodedata.normalize("NFC", str(self.value)).strip()
        if len(text) > MAX_NAME:
            raise self.error(f"longer than {MAX_NAME} characters")
        if not text.isprintable():
            raise self.error("holds an unprintable character")
        return text

    def level_name(self) -> str:
        """The value as the name of a level. ":" and "/" become "_", since they separate a floor from a position."""
        return re.sub("[:/]", "_", self.text())
