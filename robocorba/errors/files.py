"""Errors of files that are written or read."""

from __future__ import annotations

from robocorba.errors.base import RoboCorbaError


class OutputError(RoboCorbaError):
    """The output `path` of a command is not written."""

    def __init__(self, path: object, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class OutputExists(OutputError):
    """The output exists already and may not be replaced."""

    def __init__(self, path: object, remedy: str = "choose another name, or replace it with --force") -> None:
        super().__init__(path, f"exists already; {remedy}")


class OutputIsInput(OutputError):
    """The output is the file, or holds the file, from which it would be made."""

    def __init__(self, path: object) -> None:
        super().__init__(path, "this is the input itself, which is never overwritten; choose another name")


class LimitExceeded(RoboCorbaError, ValueError):
    """A file, or `what` in it, has `size` of `unit`, of which at most `limit` are read."""

    def __init__(self, what: str, size: int | str, limit: int | str, unit: str) -> None:
        self.what, self.size, self.limit, self.unit = what, size, limit, unit
        super().__init__(f"{what} has {size} {unit}, at most {limit} are read")


class WorkEnded(RoboCorbaError):
    """Work was ended before it was complete: its time was over, or nobody waits for it any more."""
