"""Errors of files that commands write or read."""

from __future__ import annotations

from robocorba.errors.base import RoboCorbaError


class OutputError(RoboCorbaError):
    """The output `path` of a command is not written."""

    def __init__(self, path: object, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class OutputExists(OutputError):
    """The output exists already and may not be replaced."""

    def __init__(self, path: object) -> None:
        super().__init__(path, "exists already; choose another name, or replace it with --force")


class OutputIsInput(OutputError):
    """The output is the file, or holds the file, from which it would be made."""

    def __init__(self, path: object) -> None:
        super().__init__(path, "this is the input itself, which is never overwritten; choose another name")
