"""The result of a program check: findings and notes."""

from __future__ import annotations

from typing import NamedTuple

from robocorba.errors.robots import InvalidProgram


class Note(NamedTuple):
    """What could not be checked of an icon, or what was assumed. icon: its path, empty for the whole program."""

    icon: str
    what: str

    def __str__(self) -> str:
        return f"{self.icon}: {self.what}" if self.icon else self.what


class CheckReport:
    """Findings and notes of a check, in the order found; only the first finding of each parameter. finding: of a
    program that can't be read."""

    def __init__(self, *finding: InvalidProgram) -> None:
        self._findings = {(each.icon, each.parameter): each for each in finding}
        self._notes: dict[Note, None] = {}

    @property
    def findings(self) -> tuple[InvalidProgram, ...]:
        return tuple(self._findings.values())

    @property
    def notes(self) -> tuple[Note, ...]:
        return tuple(self._notes)

    @property
    def is_valid(self) -> bool:
        """Whether there are no findings."""
        return not self._findings

    def require_valid(self) -> None:
        """Raise InvalidProgram for the first finding."""
        for finding in self.findings:
            raise finding

    def add_finding(self, icon: str, parameter: str, reason: str) -> None:
        """Parameters that are wrong in combination are joined, such as `x, y, z`."""
        self._findings.setdefault((icon, parameter), InvalidProgram(icon, parameter, reason))

    def add_note(self, icon: str, what: str) -> None:
        self._notes.setdefault(Note(icon, what))
