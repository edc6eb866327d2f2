"""Findings and notes of a program check."""

from __future__ import annotations

from typing import NamedTuple

from robocorba.errors.robots import InvalidProgram


class ProgramFinding(NamedTuple):
    """An error: `parameter` of the icon at a path such as icons[2].then[0], and what is wrong. Parameters that are
    wrong in combination are joined, such as `x, y, z`."""

    icon: str
    parameter: str
    what: str

    def __str__(self) -> str:
        return str(self.error())

    def error(self) -> InvalidProgram:
        """The finding as an exception."""
        return InvalidProgram(*self)


class Note(NamedTuple):
    """What could not be proved of an icon, or what was assumed; with an empty path, of the whole program."""

    icon: str
    what: str

    def __str__(self) -> str:
        return f"{self.icon}: {self.what}" if self.icon else self.what


class CheckReport:
    """Notes and findings in the order found, with the first finding of each parameter only."""

    def __init__(self) -> None:
        self._findings: dict[tuple[str, str], ProgramFinding] = {}
        self._notes: dict[Note, None] = {}

    @property
    def findings(self) -> tuple[ProgramFinding, ...]:
        return tuple(self._findings.values())

    @property
    def notes(self) -> tuple[Note, ...]:
        return tuple(self._notes)

    @property
    def is_sound(self) -> bool:
        """Whether there are no findings."""
        return not self._findings

    def find(self, icon: str, parameter: str, what: str) -> None:
        """Add a finding."""
        self._findings.setdefault((icon, parameter), ProgramFinding(icon, parameter, what))

    def note(self, icon: str, what: str) -> None:
        """Add a note."""
        self._notes.setdefault(Note(icon, what))
