"""The names of a guarded system: which reference each role finds under a name, and who holds the name."""

from __future__ import annotations

import hmac
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from robocorba.errors.services import InvalidBinding, NameHeld
from robocorba.system.roles import Role

#: A robot holds its name this long after its last announcement [s]; it announces it every 2 s.
HOLD_S = 6.0
#: Maximum number of names, and of those of robots, so that servers can always bind theirs; of parts of a name, of
#: characters of a part.
MAX_NAMES, MAX_ROBOTS, MAX_PARTS, MAX_PART = 20_000, 12_000, 8, 200

Path = tuple[str, ...]


@dataclass
class _Entry:
    references: Mapping[Role, Any]
    secret: str
    role: Role
    announced: float


class NameTable:
    """Thread-safe. robots: the naming context in which robots may bind names. clock: monotonic time [s]."""

    def __init__(self, robots: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._robots, self._clock = robots, clock
        self._lock = threading.Lock()
        self._entries: dict[Path, _Entry] = {}
        #: The number of names below each context.
        self._contexts: dict[Path, int] = {}

    def announce(self, role: Role, path: Path, references: Mapping[Role, Any], secret: str) -> None:
        """Bind a name, or renew the hold on it. Raises NameHeld, InvalidBinding."""
        self._check(role, path, references, secret)
        with self._lock:
            self._check_hold(role, path, secret)
            if path not in self._entries:
                self._check_place(role, path)
                self._count(path, 1)
            self._entries[path] = _Entry(dict(references), secret, role, self._clock())

    def withdraw(self, role: Role, path: Path, secret: str) -> None:
        """Unbind a name, if it is bound. Raises NameHeld."""
        with self._lock:
            entry = self._entries.get(path)
            if entry is None:
                return
            if not _same(entry.secret, secret):
                raise NameHeld("/".join(path))
            self._remove(path)

    def find(self, role: Role, path: Path) -> Any:
        """The reference by which a role calls the object of a name, None if it is not bound for the role."""
        with self._lock:
            entry = self._entries.get(path)
        return None if entry is None else entry.references.get(role)

    def is_context(self, path: Path) -> bool:
        """Whether there are names below this one."""
        with self._lock:
            return not path or path in self._contexts

    def children(self, path: Path) -> list[tuple[str, bool]]:
        """The names directly in a context, sorted, and whether each is a context itself."""
        with self._lock:
            entries, contexts = list(self._entries), list(self._contexts)
        depth = len(path)
        names = {entry[depth]: False for entry in entries if len(entry) == depth + 1 and entry[:depth] == path}
        names |= {context[depth]: True for context in contexts if len(context) == depth + 1 and context[:depth] == path}
        return sorted(names.items())

    def _check(self, role: Role, path: Path, references: Mapping[Role, Any], secret: str) -> None:
        name = "/".join(path)
        if not 1 <= len(path) <= MAX_PARTS or not all(1 <= len(part) <= MAX_PART for part in path):
            raise InvalidBinding(name, f"not 1 to {MAX_PARTS} parts of 1 to {MAX_PART} characters")
        if not 16 <= len(secret) <= 200:
            raise InvalidBinding(name, "the secret is too short or too long")
        if not references:
            raise InvalidBinding(name, "no reference")
        if role is not Role.SERVER and (len(path) != len(self._robots) + 1 or path[:-1] != self._robots):
            raise InvalidBinding(name, f"robots bind names in {'/'.join(self._robots)} only")

    def _check_hold(self, role: Role, path: Path, secret: str) -> None:
        entry = self._entries.get(path)
        if entry is None or _same(entry.secret, secret):
            return
        if entry.role is Role.SERVER or self._clock() - entry.announced < HOLD_S:
            raise NameHeld("/".join(path))

    def _check_place(self, role: Role, path: Path) -> None:
        name = "/".join(path)
        if path in self._contexts or any(path[:length] in self._entries for length in range(1, len(path))):
            raise InvalidBinding(name, "a name can't be a naming context too")
        most = MAX_NAMES if role is Role.SERVER else MAX_ROBOTS
        if self._number(role) >= most:
            self._forget_absent_robots()
        if self._number(role) >= most:
            raise InvalidBinding(name, f"{most} names are bound already")

    def _number(self, role: Role) -> int:
        """The number of names that count towards the limit of a role."""
        return len(self._entries) if role is Role.SERVER else self._contexts.get(self._robots, 0)

    def _forget_absent_robots(self) -> None:
        """Remove the names of robots that have not announced them lately, to make room."""
        until = self._clock() - HOLD_S
        for path, entry in list(self._entries.items()):
            if entry.role is not Role.SERVER and entry.announced <= until:
                self._remove(path)

    def _remove(self, path: Path) -> None:
        del self._entries[path]
        self._count(path, -1)

    def _count(self, path: Path, change: int) -> None:
        for length in range(1, len(path)):
            context = path[:length]
            self._contexts[context] = self._contexts.get(context, 0) + change
            if not self._contexts[context]:
                del self._contexts[context]


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(errors="replace"), other.encode(errors="replace"))
