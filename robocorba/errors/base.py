"""What all errors have in common."""

from __future__ import annotations


class RoboCorbaError(Exception):
    """Root of the tree."""


class FieldError(RoboCorbaError):
    """Part of what was asked for can't be: `field` says which, `reason` says why."""

    def __init__(self, field: str, reason: str) -> None:
        self.field, self.reason = field, reason
        super().__init__(f"{field}: {reason}")
