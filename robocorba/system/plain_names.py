"""Names for ROS and OpenRTM: letters, digits and underscores, not beginning with a digit."""

from __future__ import annotations

import re


def plain_name(name: str) -> str:
    """The name in which each other character is an underscore."""
    cleaned = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_]", "_", name))
    return f"_{cleaned}" if cleaned[:1].isdigit() else cleaned or "_"


def names_in(text: str) -> frozenset[str] | None:
    """The names in a list such as A,B; None if it is empty."""
    return frozenset(filter(None, (each.strip() for each in text.split(",")))) or None


class PlainNames:
    """Unique names for things that are called otherwise. A second one that would have the same gets a number."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def __getitem__(self, name: str) -> str:
        if name not in self._names:
            wanted = found = plain_name(name)
            number = 2
            while found in self._names.values():
                found, number = f"{wanted.rstrip('_')}_{number}", number + 1
            self._names[name] = found
        return self._names[name]
