"""Values with the versions in which they changed, for clients that ask what has changed since their own version."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Hashable, Mapping
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


def first_version() -> int:
    """The version that a process begins with. Random: clients of an earlier process hold other versions, and so get
    everything. No clock tells two processes apart: a computer without a real-time clock starts them at the same time.
    50 bits, since JavaScript has 53."""
    return 1 + secrets.randbits(50)


class Versioned(Generic[Key, Value]):
    """Values by key. Their owner numbers all changes upwards from `first` on. Not thread-safe.

    max_removed: maximum number of removals that are remembered; who has a version before `oldest` may have missed
    one."""

    def __init__(self, first: int, max_removed: int = 0) -> None:
        self.oldest = self._changed_in = first
        self._max_removed = max_removed
        #: Each value, and the version of its last change.
        self._entries: dict[Key, tuple[Value, int]] = {}
        self._removed: deque[tuple[Key, int]] = deque()

    def get(self, key: Key) -> Value | None:
        entry = self._entries.get(key)  # in one step: a reader may have no lock
        return entry[0] if entry else None

    def values(self) -> list[Value]:
        return [value for value, _ in self._entries.values()]

    def put(self, key: Key, value: Value, version: int) -> None:
        """Set one value, which changes in this version."""
        self._entries[key] = value, version
        self._changed_in = version

    def remove(self, key: Key, version: int) -> None:
        """No effect without such a value."""
        if self._entries.pop(key, None):
            self._removed.append((key, version))
            while len(self._removed) > self._max_removed:
                self.oldest = self._removed.popleft()[1]

    def replace(self, values: Mapping[Key, Value], version: int) -> bool:
        """Set all values; those that differ change in this version. Returns whether there are any, or removed ones."""
        before = self._entries
        gone = [key for key in before if key not in values]
        for key in gone:
            self.remove(key, version)
        self._entries = {
            key: before[key] if key in before and before[key][0] == value else (value, version)
            for key, value in values.items()
        }
        has_changed = any(changed_in == version for _, changed_in in self._entries.values())
        self._changed_in = version if has_changed else self._changed_in
        return has_changed or bool(gone)

    def since(self, version: int) -> dict[Key, Value]:
        """The values that have changed after a version."""
        if version >= self._changed_in:
            return {}
        return {key: value for key, (value, changed_in) in self._entries.items() if changed_in > version}

    def removed_since(self, version: int) -> list[Key]:
        """The keys of values that were removed after a version."""
        return [key for key, removed_in in self._removed if removed_in > version]
