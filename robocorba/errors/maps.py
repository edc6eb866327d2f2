"""Errors of the map editor and of map files."""

from __future__ import annotations

from robocorba.errors.base import RoboCorbaError


class MapError(RoboCorbaError):
    """The map building agent rejects a request or a file."""


class InvalidElement(MapError):
    """The element `kind`, `floor`, `name` breaks a rule; `reason` describes it."""

    def __init__(self, kind: str, floor: str, name: str, reason: str) -> None:
        self.kind, self.floor, self.name, self.reason = kind, floor, name, reason
        super().__init__(f"{describe(kind, floor, name)}: {reason}")


class UnknownElement(MapError):
    """There is no element of this kind, floor and name."""

    def __init__(self, kind: str, floor: str, name: str) -> None:
        self.kind, self.floor, self.name = kind, floor, name
        super().__init__(f"there is no {describe(kind, floor, name)}")


class DuplicateElement(MapError):
    """An element of this kind, floor and name exists already."""

    def __init__(self, kind: str, floor: str, name: str) -> None:
        self.kind, self.floor, self.name = kind, floor, name
        super().__init__(f"there is a {describe(kind, floor, name)} already")


class StaleEdit(MapError):
    """The element has version `current`, but the edit was made for version `expected`."""

    def __init__(self, kind: str, floor: str, name: str, expected: int, current: int) -> None:
        self.kind, self.floor, self.name = kind, floor, name
        self.expected, self.current = expected, current
        super().__init__(
            f"{describe(kind, floor, name)} is at version {current}, the edit was made for version {expected}"
        )


class StaleVersion(MapError):
    """The building has version `current`, but the request was made for version `expected`."""

    def __init__(self, expected: int, current: int) -> None:
        self.expected, self.current = expected, current
        super().__init__(f"the building is at version {current}, the request was made for version {expected}")


class NothingToUndo(MapError):
    """There is no edit to undo."""


class NothingToRedo(MapError):
    """There is no undone edit to redo."""


class EditedByOthers(MapError):
    """The element of an edit to undo or redo has been changed by `author` since; empty for edits without a session."""

    def __init__(self, kind: str, floor: str, name: str, author: str) -> None:
        self.kind, self.floor, self.name, self.author = kind, floor, name, author
        super().__init__(f"{describe(kind, floor, name)} has been changed by {author or 'another client'} since")


class SessionEnded(MapError):
    """The edit session was closed, was without a call for too long, or the map editor was restarted."""


class VersionUnavailable(MapError):
    """`version` is outside the kept history from `oldest` to `current`."""

    def __init__(self, version: int, oldest: int, current: int) -> None:
        self.version, self.oldest, self.current = version, oldest, current
        super().__init__(f"version {version} is outside the kept history {oldest} to {current}")


class TransactionClosed(MapError):
    """The transaction was committed, rolled back or has timed out."""


class TooManyTransactions(MapError):
    """The maximum number of transactions or of edit sessions, `limit`, is open."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"{limit} transactions or edit sessions are open already; end one")


class ServerBusy(MapError):
    """The map editor serves long requests of others; nothing was done. Try again."""


class TooSlow(MapError):
    """`what` takes longer than `limit_s`; nothing was changed."""

    def __init__(self, what: str, limit_s: float) -> None:
        self.what, self.limit_s = what, limit_s
        super().__init__(
            f"{what} takes longer than {limit_s:g} s: is the map drawn in metres? `robocorba map` works without a limit"
        )


class ReplyTooLarge(MapError):
    """The answer does not fit into a message; read it in pages."""


class MapFileError(MapError):
    """A map file is invalid. `line` is 1-based, 0 if unknown; `key` is a path such as floors[0].name."""

    def __init__(self, file: str, line: int, key: str, reason: str) -> None:
        self.file, self.line, self.key, self.reason = file, line, key, reason
        where = f"{file}:{line}" if line else file
        super().__init__(f"{where}: {key}: {reason}" if key else f"{where}: {reason}")


class GridTooLarge(MapError):
    """An occupancy grid of a floor would have too many cells."""


def describe(kind: str, floor: str, name: str) -> str:
    """The name of an element in messages, such as "wall 'w1' on L2"."""
    subject = f"{kind} {_short(name)!r}" if name else kind
    return f"{subject} on {_short(floor)}" if floor else subject


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:60]}… ({len(text)} characters)"
