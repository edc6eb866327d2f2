"""Values that no map expects, put anywhere into nested data."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

#: Stands for a key that is taken out.
MISSING = object()
HOSTILE: list[Any] = [
    None,
    True,
    -1,
    0,
    10**18,
    1e308,
    -1e-320,
    float("nan"),
    float("inf"),
    "",
    "x" * 300,
    "a\x07b",
    "1e-05",
    [],
    [[]],
    [1, 2, 3, 4, 5, 6],
    {},
    {"a": {"b": []}},
    {1: 2},
    MISSING,
]


def places(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in nested data, as the keys and indices that lead to it."""
    if at:
        yield at
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in entries:
        yield from places(value, (*at, key))


def at(data: Any, place: tuple[Any, ...]) -> Any:
    """The value at a place."""
    for key in place:
        data = data[key]
    return data


def changed(whole: dict[str, Any], place: tuple[Any, ...], change: Any) -> dict[str, Any]:
    """Data with a value replaced, or taken out where `change` is MISSING."""
    data = copy.deepcopy(whole)
    *way, last = place
    holder = at(data, tuple(way))
    if change is MISSING:
        del holder[last]
    else:
        holder[last] = change
    return data
