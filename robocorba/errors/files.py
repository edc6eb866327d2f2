"""Errors of files that are written or read."""

from __future__ import annotations

from robocorba.errors.base import RoboCorbaError, StructuredError


class OutputError(StructuredError):
    """The output `path` of a command is not written."""

    path: object
    reason: str
    message = "{path}: {reason}"


class LimitExceeded(StructuredError, ValueError):
    """A file, or `what` in it, has `size` of `unit`, of which at most `limit` are read."""

    what: str
    size: int | str
    limit: int | str
    unit: str
    message = "{what} has {size} {unit}, at most {limit} are read"


class WorkEnded(RoboCorbaError):
    """Work was ended before it was complete: its time was over, or nobody waits for it any more."""
