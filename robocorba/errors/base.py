"""Base classes of all errors."""

from __future__ import annotations


class RoboCorbaError(Exception):
    """Root of all errors that RoboCorba raises on purpose."""


class FieldError(RoboCorbaError):
    """`field` of a request is invalid; `reason` is why."""

    def __init__(self, field: str, reason: str) -> None:
        self.field, self.reason = field, reason
        super().__init__(f"{field}: {reason}")
