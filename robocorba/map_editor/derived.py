"""Results that are derived from the maps of a building, and kept no longer than these."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

from robocorba.map_editor.model import GeometricalMap, TopologicalMap

Map = TypeVar("Map", GeometricalMap, TopologicalMap)
Result = TypeVar("Result")


class Derived(Generic[Map, Result]):
    """Results, each derived from parts of a building that no edit changes, such as the walls of a map.

    A result is kept as long as the map for which it was asked last. A cache of the latest results would keep earlier
    versions of a map with tens of thousands of walls: 8 MB each for 20,000. Thread-safe without a lock: the worst that
    threads do to each other is to derive a result twice."""

    def __init__(self) -> None:
        #: By the identities of the parts: the parts, their result, and the map for which it was asked last.
        self._kept: dict[tuple[int, ...], tuple[tuple[object, ...], Result, weakref.ref[Map]]] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def of(self, asked_for: Map, parts: tuple[object, ...], derive: Callable[[], Result]) -> Result:
        """The result for these parts, compared by identity; `derive` finds it. Neither may refer to the map."""
        key = tuple(map(id, parts))
        kept = self._kept.get(key)
        if kept is not None and kept[2]() is asked_for:
            return kept[1]
        result = derive() if kept is None else kept[1]
        self._kept[key] = parts, result, self._watch(asked_for, key)
        return result

    def _watch(self, asked_for: Map, key: tuple[int, ...]) -> weakref.ref[Map]:
        """A reference to the map; the result goes with it, unless it was asked for another one since."""

        def forget(gone: weakref.ref[Map]) -> None:
            kept = self._kept.get(key)
            if kept is not None and kept[2] is gone:
                self._kept.pop(key, None)

        return weakref.ref(asked_for, forget)
