"""Errors of the map editor and of map files."""

from __future__ import annotations

from robocorba.errors.base import RoboCorbaError, StructuredError


class MapError(RoboCorbaError):
    """The map building agent rejects a request or a file."""


class ElementError(StructuredError, MapError):
    """About the element `kind`, `floor`, `name`."""

    kind: str
    floor: str
    name: str

    @property
    def element(self) -> str:
        """The name of the element in messages."""
        return describe(self.kind, self.floor, self.name)


class InvalidElement(ElementError):
    """The element breaks a rule; `reason` describes it."""

    reason: str
    message = "{element}: {reason}"


class UnknownElement(ElementError):
    """There is no element of this kind, floor and name."""

    message = "there is no {element}"


class DuplicateElement(ElementError):
    """An element of this kind, floor and name exists already."""

    message = "there is a {element} already"


class StaleEdit(ElementError):
    """The element has version `current`, but the edit was made for version `expected`."""

    expected: int
    current: int
    message = "{element} is at version {current}, the edit was made for version {expected}"


class StaleVersion(StructuredError, MapError):
    """The building has version `current`, but the request was made for version `expected`."""

    expected: int
    current: int
    message = "the building is at version {current}, the request was made for version {expected}"


class NothingToUndo(MapError):
    """There is no edit to undo."""


class NothingToRedo(MapError):
    """There is no undone edit to redo."""


class EditedByOthers(ElementError):
    """The element of an edit to undo or redo has been changed by `author` since; empty for edits without a session."""

    author: str

    def __str__(self) -> str:
        return f"{self.element} has been changed by {self.author or 'another client'} since"


class SessionEnded(MapError):
    """The edit session was closed, was without a call for too long, or the map editor was restarted."""


class VersionUnavailable(StructuredError, MapError):
    """`version` is outside the kept history from `oldest` to `current`."""

    version: int
    oldest: int
    current: int
    message = "version {version} is outside the kept history {oldest} to {current}"


class TransactionClosed(MapError):
    """The transaction was committed, rolled back or has timed out."""


class TooManyTransactions(StructuredError, MapError):
    """The maximum number of transactions or of edit sessions, `limit`, is open."""

    limit: int
    message = "{limit} transactions or edit sessions are open already; end one"


class ServerBusy(MapError):
    """The map editor serves long requests of others; nothing was done. Try again."""


class TooSlow(StructuredError, MapError):
    """`what` takes longer than `limit_s`; nothing was changed."""

    what: str
    limit_s: float
    message = (
        "{what} takes longer than {limit_s:g} s: is the map drawn in metres? `robocorba map` works without a limit"
    )


class ReplyTooLarge(MapError):
    """The answer does not fit into a message; read it in pages."""


class MapFileError(StructuredError, MapError):
    """A map file is invalid. `line` is 1-based, 0 if unknown; `key` is a path such as floors[0].name."""

    file: str
    line: int
    key: str
    reason: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        return f"{where}: {self.key}: {self.reason}" if self.key else f"{where}: {self.reason}"


class GridTooLarge(MapError):
    """An occupancy grid of a floor would have too many cells."""


def describe(kind: str, floor: str, name: str) -> str:
    """The name of an element in messages, such as "wall 'w1' on L2"."""
    subject = f"{kind} {_short(name)!r}" if name else kind
    return f"{subject} on {_short(floor)}" if floor else subject


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:60]}… ({len(text)} characters)"
